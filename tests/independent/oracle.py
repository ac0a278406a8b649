#!/usr/bin/env python3
"""An independent reading of the meaning of the grid, to check `tog replay` cell by cell.

It was written from the page that defines every number (scan -> frame -> temporal grid -> class ->
collapsed map), not from the Rust code, and shares nothing with it: other language, other bag
reader (rosbags), other algorithm (whole arrays, no changes, no bit planes).

    oracle.py RECORDING.bag OUT   OUT: from `tog replay RECORDING.bag --out OUT --every-frame`
    oracle.py --self-test         checks this program against loops that follow the text literally

Compared exactly: frames.npy, classes.npy, collapsed_counts.npy, occupancy_last.npy.
Exit code: 0 every number agrees, 1 something differs, 2 the comparison could not be made.

Decided here, because the page leaves it open: round() of timescale / T goes half up; the geometry
of a laser (angle_min, angle_increment, beams, range_min, range_max) is that of its first scan, and
a scan that differs in any of them is dropped, as is one whose stamp is not after the last kept one.
"""

import argparse
import json
import math
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError

import walk_bag

UNKNOWN = 255
LASER_SCAN = "sensor_msgs/msg/LaserScan"
MAX_FRAMES = 5_000_000  # 5.8 days at 10 Hz; more than that means that a stamp is wrong
PROTOTYPES = {  # name -> id, prototype over (1, 15, 60) s
    "empty": (0, (0.0, 0.0, 0.0)),
    "passing": (1, (1.0, 0.0, 0.0)),
    "lingering": (2, (1.0, 1.0, 0.0)),
    "vacated": (3, (0.0, 0.0, 1.0)),
    "background": (4, (1.0, 1.0, 1.0)),
}
TRANSIT = ("transit", 5)


class CannotCompare(Exception):
    """The inputs do not allow a comparison; the text says what was found and what was expected."""


@dataclass
class Options:
    """What grid.json does not hold; None and the rest are the defaults of the page."""

    dphi_rad: float | None = None
    dr_m: float | None = None
    known_share_min: float = 0.5
    no_return_is_free: bool = True


@dataclass
class Track:
    """The kept scans of one laser: geometry as f64 of the message's f32, ranges [scan, beam]."""

    geometry: tuple = ()  # angle_min, angle_increment, beams, range_min, range_max
    stamps_ns: list = field(default_factory=list)
    ranges_m: list = field(default_factory=list)
    dropped_order: int = 0
    dropped_geometry: int = 0

    def offer(self, stamp_ns, geometry, ranges_m):
        """Keeps a scan, or drops and counts it."""
        if self.geometry and geometry != self.geometry:
            self.dropped_geometry += 1
        elif self.stamps_ns and stamp_ns <= self.stamps_ns[-1]:
            self.dropped_order += 1
        else:
            self.geometry = geometry
            self.stamps_ns.append(stamp_ns)
            self.ranges_m.append(np.asarray(ranges_m, dtype=np.float64))


def scans_of(path):
    """(topic, message) of the scans, in the order in which the recorder received them."""
    try:
        with AnyReader([Path(path)]) as reader:
            connections = [c for c in reader.connections if c.msgtype == LASER_SCAN]
            return [
                (connection.topic, reader.deserialize(raw, connection.msgtype))
                for connection, _, raw in reader.messages(connections=connections)
            ]
    except (AssertionError, AnyReaderError) as error:  # it asserts what the index should say
        print(f"{path}: rosbags refuses the bag ({error!r}); reading the records one by one")
        return list(walk_bag.scans(path, LASER_SCAN))


def read_bag(path):
    """Tracks by topic."""
    tracks = {}
    for topic, scan in scans_of(path):
        stamp_ns = scan.header.stamp.sec * 1_000_000_000 + scan.header.stamp.nanosec
        angles = (float(scan.angle_min), float(scan.angle_increment))
        geometry = (*angles, len(scan.ranges), float(scan.range_min), float(scan.range_max))
        tracks.setdefault(topic, Track()).offer(stamp_ns, geometry, scan.ranges)
    if not tracks:
        raise CannotCompare(f"{path}: no message of type {LASER_SCAN} in it")
    return tracks


def match_lasers(lasers, tracks):
    """Pairs each laser of grid.json with a topic: by name (without slashes), else by order."""

    def plain(name):
        return "".join(ch for ch in name.lower() if ch.isalnum())

    by_name = {plain(topic): topic for topic in tracks}
    topics = [by_name.get(plain(laser["id"])) for laser in lasers]
    if None in topics or len(set(topics)) != len(topics):
        if len(lasers) != len(tracks):
            ids = [laser["id"] for laser in lasers]
            raise CannotCompare(f"lasers {ids} of grid.json and topics {list(tracks)} do not pair")
        topics = sorted(tracks)
    return topics


def check_geometry(laser, topic, track):
    """Differences between a laser of grid.json and the first scan, as lines of text."""
    keys = ("angle_min_rad", "angle_increment_rad", "beams", "range_min_m", "range_max_m")
    return [
        f"laser {laser['id']}: {key} is {laser[key]!r} in grid.json, {value!r} in {topic}"
        for key, value in zip(keys, track.geometry)
        if laser[key] != value
    ]


def beams_of_cells(grid, laser, options):
    """For every cell the beams whose wedge holds its centre: (rho [cell], beam [slot, cell]).

    An empty slot holds the number `beams`, where `sense` keeps a reading that says nothing.
    """
    cell = grid["cell_m"]
    x_m = grid["origin_m"][0] + (np.arange(grid["columns"]) + 0.5) * cell - laser["x_m"]
    y_m = grid["origin_m"][1] + (np.arange(grid["rows"]) + 0.5) * cell - laser["y_m"]
    dx, dy = (a.ravel() for a in np.meshgrid(x_m, y_m))
    rho = np.hypot(dx, dy)
    beta = np.arctan2(dy, dx) - laser["yaw_rad"]
    first, step, beams = laser["angle_min_rad"], laser["angle_increment_rad"], laser["beams"]
    dphi = options.dphi_rad if options.dphi_rad is not None else abs(step) / 2
    reach = math.ceil(dphi / abs(step)) + 1
    slots = []
    turn = 2 * math.pi
    # Bearings repeat every turn: look at the beams near beta in every turn that the laser spans.
    for k in range(-3, 4):
        near = np.rint((beta + k * turn - first) / step).astype(np.int64)
        for beam in range(-reach, reach + 1):
            b = near + beam
            off = np.abs(beta - (first + b * step))
            off = np.abs(off - turn * np.rint(off / turn))
            slots.append(np.where((b >= 0) & (b < beams) & (off <= dphi), b, beams))
    slots = np.sort(np.array(slots), axis=0)
    slots[1:][slots[1:] == slots[:-1]] = beams  # the same beam found twice
    slots = np.sort(slots, axis=0)
    used = max(1, int((slots < beams).any(axis=1).sum()))
    return rho, slots[:used]


def sense(ranges_m, laser, rho, beams, dr, options):
    """R of every cell for one scan: +1 hit, -1 miss, 0 unknown (Eq. 6, REP 117)."""
    low, high = laser["range_min_m"], laser["range_max_m"]
    echo = np.isfinite(ranges_m) & (ranges_m >= low) & (ranges_m < high)
    silent = ranges_m >= high  # +inf too; every comparison with NaN is false
    # hit needs |rho - r| < dr, miss needs rho < end: NaN and -inf make both false.
    r = np.append(np.where(echo, ranges_m, np.nan), np.nan)
    free_to = high - dr if options.no_return_is_free else -np.inf
    end = np.where(echo, ranges_m - dr, np.where(silent, free_to, -np.inf))
    end = np.append(end, -np.inf)
    result = np.zeros(rho.shape, dtype=np.int8)
    for slot in beams:
        hit = np.abs(rho - r[slot]) < dr
        miss = rho < end[slot]
        np.copyto(result, -1, where=miss & (result == 0))
        np.copyto(result, 1, where=hit)
    return result


def fuse(grid, tracks, topics, options):
    """The frames of the lattice: (first index m, R [frame, cell] as int8)."""
    period, age = grid["frame_period_ns"], int(round(grid["scan_age_max_ms"] * 1_000_000))
    dr = options.dr_m if options.dr_m is not None else max(0.01, 0.6 * grid["cell_m"])
    stamps = [np.array(tracks[topic].stamps_ns, dtype=np.int64) for topic in topics]
    first = -(-min(int(s[0]) for s in stamps) // period)
    last = max(int(s[-1]) for s in stamps) // period
    if last - first >= MAX_FRAMES:
        raise CannotCompare(f"{last - first + 1} frames from {first} to {last}: a stamp is wrong")
    result = np.zeros((max(0, last - first + 1), grid["rows"] * grid["columns"]), dtype=np.int8)
    for laser, topic, at in zip(grid["lasers"], topics, stamps):
        rho, beams = beams_of_cells(grid, laser, options)
        cached, known = -1, None
        for i in range(len(result)):
            tau = (first + i) * period
            newest = int(np.searchsorted(at, tau, side="right")) - 1
            if newest < 0 or int(at[newest]) <= tau - age:
                continue
            if newest != cached:
                ranges = tracks[topic].ranges_m[newest]
                cached, known = newest, sense(ranges, laser, rho, beams, dr, options)
            # hit > miss > unknown, also between lasers
            row = result[i]
            np.copyto(row, known, where=(known == 1) | (row == 0))
    return first, result


def prototypes_of(grid):
    """(ids, prototypes [class, timescale], transit id or None) of grid.json's preset."""
    preset = grid["preset"]
    if preset not in ("default", "paper", "onehot"):
        raise CannotCompare(f"preset {preset!r}: only default, paper and onehot are known here")
    table = dict(PROTOTYPES)
    if preset == "onehot":
        table["lingering"] = (2, (0.0, 1.0, 0.0))
    expected = {name: class_id for name, (class_id, _) in table.items()}
    if preset != "paper":
        expected[TRANSIT[0]] = TRANSIT[1]
    found = {c["name"]: c["id"] for c in grid["classes"] if c["id"] != UNKNOWN}
    if found != expected:
        raise CannotCompare(f"classes {found} in grid.json, but preset {preset} has {expected}")
    if len(grid["timescales_s"]) != 3:
        raise CannotCompare(f"timescales {grid['timescales_s']}: the presets have three")
    ids, vectors = zip(*sorted(table.values()))
    return list(ids), np.array(vectors), expected.get(TRANSIT[0])


def windows_of(grid):
    """N_k = max(1, round(timescale_k / T)) frames."""
    period = grid["frame_period_ns"]
    spans_ns = [int(round(t * 1e9)) for t in grid["timescales_s"]]
    return [max(1, (2 * span + period) // (2 * period)) for span in spans_ns]


def classify(r, grid, options):
    """Yields for every frame (classes [cell], occupancy [timescale, cell], S, K) (Eq. 7, 8)."""
    ids, vectors, transit = prototypes_of(grid)
    windows = windows_of(grid)
    longest, shortest = max(windows), min(windows)
    cells = r.shape[1]
    sums = np.zeros((len(windows), cells), dtype=np.int64)
    known, hits = np.zeros(cells, dtype=np.int64), np.zeros(cells, dtype=np.int64)
    for m, now in enumerate(r):
        for k, n in enumerate(windows):
            sums[k] += now
            if m >= n:
                sums[k] -= r[m - n]
        known += now != 0
        if m >= longest:
            known -= r[m - longest] != 0
        hits += now == 1
        if m >= shortest:
            hits -= r[m - shortest] == 1
        occupancy = (sums / np.array(windows, dtype=np.float64)[:, None] + 1) / 2
        best, classes = np.full(cells, np.inf), np.zeros(cells, dtype=np.uint8)
        for class_id, vector in zip(ids, vectors):
            distance = np.zeros(cells)
            for o, p in zip(occupancy, vector):
                distance += (o - p) * (o - p)
            nearer = distance < best
            best[nearer], classes[nearer] = distance[nearer], class_id
        if transit is not None:
            classes[(classes == 0) & (hits > 0)] = transit
        classes[known < options.known_share_min * longest] = UNKNOWN
        yield classes, occupancy, sums, known


class Verdict:
    """Prints a line per array and remembers whether everything agreed."""

    def __init__(self, show):
        self.show, self.all_agree = show, True

    def line(self, name, differing, total, notes=()):
        agree = differing == 0
        self.all_agree &= agree
        print(f"{name:24} {'agrees' if agree else 'DIFFERS':8} {differing} of {total} differ")
        for note in list(notes)[: self.show]:
            print(f"    {note}")

    def array(self, name, found, expected):
        """Whole-array comparison: type, shape, then every element exactly."""
        if found.dtype != expected.dtype or found.shape != expected.shape:
            what = (
                f"{found.dtype}{list(found.shape)}, {expected.dtype}{list(expected.shape)} expected"
            )
            return self.line(name, max(1, expected.size), expected.size, [f"is {what}"])
        where = np.argwhere(found != expected)
        notes = (
            f"at {w.tolist()}: {found[tuple(w)]!r}, {expected[tuple(w)]!r} expected" for w in where
        )
        return self.line(name, len(where), expected.size, notes)


def compare(tracks, out, options, show=5):
    """Compares the output directory with what the tracks mean; true if every number agrees."""
    grid = json.loads((out / "grid.json").read_text())
    topics = match_lasers(grid["lasers"], tracks)
    verdict, geometry = Verdict(show), []
    for laser, topic in zip(grid["lasers"], topics):
        t = tracks[topic]
        print(
            f"laser {laser['id']} = topic {topic}: {len(t.stamps_ns)} scans, dropped "
            f"{t.dropped_order} for their stamp, {t.dropped_geometry} for their geometry"
        )
        geometry += check_geometry(laser, topic, t)
    verdict.line("grid.json geometry", len(geometry), 5 * len(topics), geometry)
    first, r = fuse(grid, tracks, topics, options)
    shape = (grid["rows"], grid["columns"])
    frames = np.arange(first, first + len(r), dtype=np.uint64)
    verdict.array("frames.npy", np.load(out / "frames.npy"), frames)
    found = np.load(out / "classes.npy", mmap_mode="r")
    same_shape = found.shape == (len(r), *shape) and found.dtype == np.uint8
    counts = np.zeros((UNKNOWN + 1, shape[0] * shape[1]), dtype=np.uint64)
    cells, differing, notes, occupancy = np.arange(counts.shape[1]), 0, [], None
    for i, (classes, occupancy, sums, known) in enumerate(classify(r, grid, options)):
        counts[classes, cells] += np.uint64(1)
        if not same_shape:
            continue
        where = np.flatnonzero(found[i].ravel() != classes)
        differing += len(where)
        for c in where[: max(0, show - len(notes))]:
            row, column = divmod(int(c), shape[1])
            notes.append(
                f"frame {first + i} (no. {i}) row {row} column {column}: {found[i, row, column]}, "
                f"{classes[c]} expected; S {sums[:, c].tolist()}, N {windows_of(grid)}, "
                f"K {known[c]}, R {r[i, c]}"
            )
    if same_shape:
        verdict.line("classes.npy", differing, found.size, notes)
    else:
        verdict.array("classes.npy", found, np.zeros((len(r), *shape), dtype=np.uint8))
    ids = sorted(c["id"] for c in grid["classes"] if c["id"] != UNKNOWN)
    counts_found = np.load(out / "collapsed_counts.npy")
    verdict.array("collapsed_counts.npy", counts_found, counts[ids].reshape(len(ids), *shape))
    if occupancy is None:
        occupancy = np.full((len(grid["timescales_s"]), len(cells)), 0.5)
    occupancy = occupancy.reshape(-1, *shape)
    verdict.array("occupancy_last.npy", np.load(out / "occupancy_last.npy"), occupancy)
    seen = {i: int(counts[i].sum()) for i in range(UNKNOWN + 1) if counts[i].any()}
    print(f"{len(r)} frames of {shape[0]} x {shape[1]} cells; cell-frames by class id: {seen}")
    print("verdict: every number agrees" if verdict.all_agree else "verdict: DIFFERENT")
    return verdict.all_agree


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("recording", nargs="?", type=Path, help="a ROS 1 bag (format 2.0 or 1.2)")
    parser.add_argument("out", nargs="?", type=Path, help="directory with grid.json and the arrays")
    parser.add_argument("--dr-m", type=float, help="default max(0.01, 0.6 cell)")
    parser.add_argument("--dphi-rad", type=float, help="default half the angular increment")
    parser.add_argument("--known-share-min", type=float, default=0.5)
    parser.add_argument("--no-return", choices=("free", "unknown"), default="free")
    parser.add_argument("--show", type=int, default=5, help="differences to print per array")
    parser.add_argument("--self-test", action="store_true")
    args = parser.parse_args()
    if args.self_test:
        import self_test

        return self_test.main()
    if args.recording is None or args.out is None:
        parser.error("a recording and an output directory are needed")
    options = Options(args.dphi_rad, args.dr_m, args.known_share_min, args.no_return == "free")
    outs = [
        p.parent
        for p in sorted([args.out / "grid.json", *args.out.glob("*/grid.json")])
        if p.exists()
    ]
    try:
        if not outs:
            raise CannotCompare(f"{args.out}: no grid.json in it or one level below")
        tracks = read_bag(args.recording)
        agree = True
        for out in outs:
            print(f"== {out}")
            agree &= compare(tracks, out, options, args.show)
    except (CannotCompare, OSError, KeyError, ValueError) as error:
        print(f"cannot compare: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    except Exception as error:  # rosbags raises types of its own for a damaged bag
        print(f"cannot read {args.recording}: {type(error).__name__}: {error}", file=sys.stderr)
        return 2
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
