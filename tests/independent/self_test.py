"""Checks the oracle: random bags, every number by plain loops over the text of the page.

The loops share no step with oracle.py but the reading of the bag: each cell of each frame asks
every beam of every laser, windows are summed from nothing, averages are exact fractions.
"""

import contextlib
import io
import json
import math
import random
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

import oracle
import walk_bag

ECHO_CODES = (math.nan, math.inf, -math.inf, 0.0, 0.05, 3.0, 3.5, 9.0)
NS = 1_000_000_000


def write_bag(path, rng, lasers, start_ns, seconds):
    """Writes scans of each laser with jitter, a hole, repeats, jumps back and other geometries."""
    store = get_typestore(Stores.ROS1_NOETIC)
    scan_type = store.types["sensor_msgs/msg/LaserScan"]
    header_type, time_type = (
        store.types["std_msgs/msg/Header"],
        store.types["builtin_interfaces/msg/Time"],
    )
    planned = []
    for laser in lasers:
        stamp = start_ns + rng.randrange(80_000_000)
        while stamp < start_ns + seconds * NS:
            planned.append((stamp, stamp, laser["beams"], laser))
            if rng.random() < 0.1:  # a repeat, an old scan, a stamp of last year, a wrong count
                odd = rng.choice((0, 1, 150_000_000, 365 * 86_400 * NS, -1))
                beams = laser["beams"] - (1 if odd == -1 else 0)
                planned.append((stamp + 5, stamp - odd, beams, laser))
            stamp += laser["period_ns"] + rng.randrange(-9_000_000, 9_000_000)
            stamp += 700_000_000 if rng.random() < 0.05 else 0
    planned.sort(key=lambda p: p[0])
    with Writer(path) as writer:
        topics = {
            laser["topic"]: writer.add_connection(
                laser["topic"], oracle.LASER_SCAN, typestore=store
            )
            for laser in lasers
        }
        for n, (received, stamp, beams, laser) in enumerate(planned):
            ranges = [
                rng.choice(ECHO_CODES) if rng.random() < 0.3 else rng.uniform(0.1, 3.2)
                for _ in range(beams)
            ]
            message = scan_type(
                header=header_type(seq=n, stamp=time_type(stamp // NS, stamp % NS), frame_id="l"),
                angle_min=laser["angle_min"],
                angle_max=laser["angle_min"] + laser["step"] * (beams - 1),
                angle_increment=laser["step"],
                time_increment=0.0,
                scan_time=0.1,
                range_min=0.06,
                range_max=3.0,
                ranges=np.array(ranges, dtype=np.float32),
                intensities=np.array([], dtype=np.float32),
            )
            raw = store.serialize_ros1(message, oracle.LASER_SCAN)
            writer.write(topics[laser["topic"]], received, bytes(raw))


def literal_sense(laser, ranges, dx, dy, dr):
    """R of one cell from one scan, beam by beam."""
    rho = float(np.hypot(dx, dy))
    beta = float(np.arctan2(dy, dx)) - laser["yaw_rad"]
    result = 0
    for b, r in enumerate(ranges):
        phi = laser["angle_min_rad"] + b * laser["angle_increment_rad"]
        off = min(abs(beta - phi + 2 * math.pi * k) for k in (-2, -1, 0, 1, 2))
        if off > abs(laser["angle_increment_rad"]) / 2:
            continue
        if math.isnan(r) or r < laser["range_min_m"]:
            continue
        if r >= laser["range_max_m"]:
            state = -1 if rho < laser["range_max_m"] - dr else 0
        elif abs(rho - r) < dr:
            state = 1
        else:
            state = -1 if rho < r - dr else 0
        result = max((result, state), key=lambda s: (0, 2, 1)[s])  # hit > miss > unknown
    return result


def literal_r(grid, tracks, topics):
    """(lattice indices, R [frame][cell]) with a scan chosen by looking at all of them."""
    period, age = grid["frame_period_ns"], grid["scan_age_max_ms"] * 1_000_000
    dr = max(0.01, 0.6 * grid["cell_m"])
    all_stamps = [s for t in topics for s in tracks[t].stamps_ns]
    frames = list(
        range(math.ceil(Fraction(min(all_stamps), period)), max(all_stamps) // period + 1)
    )
    centres = [
        (
            grid["origin_m"][0] + (c + 0.5) * grid["cell_m"],
            grid["origin_m"][1] + (r + 0.5) * grid["cell_m"],
        )
        for r in range(grid["rows"])
        for c in range(grid["columns"])
    ]
    result = []
    for m in frames:
        tau, row = m * period, [0] * len(centres)
        for laser, topic in zip(grid["lasers"], topics):
            fresh = [i for i, s in enumerate(tracks[topic].stamps_ns) if tau - age < s <= tau]
            if not fresh:
                continue
            ranges = tracks[topic].ranges_m[fresh[-1]].tolist()
            for i, (x, y) in enumerate(centres):
                state = literal_sense(laser, ranges, x - laser["x_m"], y - laser["y_m"], dr)
                row[i] = max((row[i], state), key=lambda s: (0, 2, 1)[s])
        result.append(row)
    return frames, result


def literal_class(history, windows, preset):
    """(class, occupancy per timescale) of a cell with this history of R, newest last."""
    padded = [0] * max(windows) + history
    if sum(r != 0 for r in padded[-max(windows) :]) < max(windows) / 2:
        best = oracle.UNKNOWN
    else:
        best = None
    mean = [Fraction(sum(padded[-n:]), n) for n in windows]
    occupancy = [(float(s) + 1) / 2 for s in mean]
    lingering = (0, 1, 0) if preset == "onehot" else (1, 1, 0)
    vectors = [(0, 0, 0), (1, 0, 0), lingering, (0, 0, 1), (1, 1, 1)]
    distances = [sum((o - p) ** 2 for o, p in zip(occupancy, v)) for v in vectors]
    if best is None:
        best = distances.index(min(distances))
        if best == 0 and preset != "paper" and 1 in padded[-min(windows) :]:
            best = 5
    return best, occupancy


def write_literal(out, grid, tracks, topics):
    """Writes the four arrays and grid.json as the loops have them."""
    frames, r = literal_r(grid, tracks, topics)
    period, shape = grid["frame_period_ns"], (grid["rows"], grid["columns"])
    windows = [
        max(1, math.floor(Fraction(round(t * NS), period) + Fraction(1, 2)))
        for t in grid["timescales_s"]
    ]
    cells = shape[0] * shape[1]
    classes = np.zeros((len(frames), cells), dtype=np.uint8)
    last = np.zeros((len(windows), cells))
    for c in range(cells):
        history = [row[c] for row in r]
        for i in range(len(frames)):
            classes[i, c], last[:, c] = literal_class(history[: i + 1], windows, grid["preset"])
    ids = [c["id"] for c in grid["classes"] if c["id"] != oracle.UNKNOWN]
    counts = np.array([(classes == i).sum(axis=0) for i in ids], dtype=np.uint64)
    np.save(out / "frames.npy", np.array(frames, dtype=np.uint64))
    np.save(out / "classes.npy", classes.reshape(len(frames), *shape))
    np.save(out / "collapsed_counts.npy", counts.reshape(len(ids), *shape))
    np.save(out / "occupancy_last.npy", last.reshape(len(windows), *shape))
    (out / "grid.json").write_text(json.dumps(grid))


def random_case(seed, folder):
    """A bag and a grid.json for it: (bag path, grid)."""
    rng = random.Random(seed)
    f32 = lambda x: float(np.float32(x))
    lasers = []
    for n, topic in enumerate(("/left_scan", "/right/scan")):
        beams = rng.choice((24, 31))
        span = rng.choice((2 * math.pi, 3.9, 1.2))
        step = f32(span / beams) * rng.choice((1, 1, -1))
        low = f32(-span / 2 if step > 0 else span / 2)
        period = rng.choice((66_000_000, 100_000_000, 133_000_000))
        lasers.append(
            {"topic": topic, "beams": beams, "step": step, "angle_min": low, "period_ns": period}
        )
    bag = folder / f"{seed}.bag"
    write_bag(bag, rng, lasers, 1_600_000_000 * NS + rng.randrange(NS), 4)
    names = [(i, n) for n, (i, _) in oracle.PROTOTYPES.items()]
    preset = ("default", "paper", "onehot")[seed % 3]
    names += [] if preset == "paper" else [(5, "transit")]
    grid = {
        "area": "room",
        "origin_m": [-1.0, -0.8],
        "cell_m": rng.choice((0.25, 0.2)),
        "columns": 10,
        "rows": 7,
        "frame_period_ns": rng.choice((100_000_000, 133_000_000)),
        "scan_age_max_ms": 250,
        "timescales_s": [0.3, 1.0, 2.0],
        "preset": preset,
        "classes": [{"id": i, "name": n} for i, n in names],
        "lasers": [
            {
                "id": laser["topic"].strip("/").replace("/", "_"),
                "x_m": rng.choice((0.0, 0.1, rng.uniform(-1, 1))),
                "y_m": rng.choice((0.0, -0.1, rng.uniform(-1, 1))),
                "yaw_rad": rng.choice((0.0, math.pi / 2, rng.uniform(-math.pi, math.pi))),
                "angle_min_rad": laser["angle_min"],
                "angle_increment_rad": laser["step"],
                "beams": laser["beams"],
                "range_min_m": f32(0.06),
                "range_max_m": 3.0,
            }
            for laser in lasers
        ],
    }
    return bag, grid


def agrees(tracks, out):
    """The verdict of the oracle, and what it printed."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        verdict = oracle.compare(tracks, out, oracle.Options())
    return verdict, printed.getvalue()


def same_scans(bag):
    """Whether rosbags and walk_bag read the same from a bag."""

    def plain(scan):
        topic, m = scan
        return topic, m.header.seq, m.header.stamp.sec, m.header.stamp.nanosec, m.ranges.tobytes()

    walked = [plain(s) for s in walk_bag.scans(bag, oracle.LASER_SCAN)]
    read = [plain(s) for s in oracle.scans_of(bag)]
    if walked != read or not read:
        print(f"{bag}: walk_bag reads {len(walked)} scans, rosbags {len(read)}: NOT THE SAME")
    return walked == read and bool(read)


def damage(out, name, change):
    """Replaces an array by a changed copy; returns a function that puts the old one back."""
    old = np.load(out / name)
    new = old.copy()
    new = change(new)
    np.save(out / name, new)
    return lambda: np.save(out / name, old)


def flip(array, value):
    array.flat[array.size // 3] = value(array.flat[array.size // 3])
    return array


DAMAGES = (
    ("classes.npy", "one class", lambda a: flip(a, lambda v: 1 if v != 1 else 0)),
    ("classes.npy", "one frame less", lambda a: a[:-1]),
    ("frames.npy", "one lattice index", lambda a: flip(a, lambda v: v + np.uint64(1))),
    ("collapsed_counts.npy", "one count", lambda a: flip(a, lambda v: v + np.uint64(1))),
    ("collapsed_counts.npy", "the type", lambda a: a.astype(np.int64)),
    (
        "occupancy_last.npy",
        "the last bit of a number",
        lambda a: flip(a, lambda v: np.nextafter(v, 2)),
    ),
)


def main(seeds=12):
    """Runs the checks; 0 if all hold."""
    failed, classes_seen = 0, set()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(seeds):
            out = Path(folder) / str(seed)
            out.mkdir()
            bag, grid = random_case(seed, Path(folder))
            tracks = oracle.read_bag(bag)
            topics = oracle.match_lasers(grid["lasers"], tracks)
            failed += not same_scans(bag)
            write_literal(out, grid, tracks, topics)
            verdict, text = agrees(tracks, out)
            classes_seen |= set(np.unique(np.load(out / "classes.npy")).tolist())
            dropped = [
                sum(getattr(t, k) for t in tracks.values())
                for k in ("dropped_order", "dropped_geometry")
            ]
            print(
                f"case {seed}: {grid['preset']}, dropped {dropped}: {'ok' if verdict else 'FAILED'}"
            )
            if not verdict:
                print(text)
            failed += not verdict
        for name, what, change in DAMAGES:
            restore = damage(out, name, change)
            verdict, _ = agrees(tracks, out)
            restore()
            print(f"damage to {name}, {what}: {'NOT SEEN' if verdict else 'seen'}")
            failed += verdict
        verdict, _ = agrees(tracks, out)
        failed += not verdict
    missing = {0, 1, 2, 3, 4, 5, oracle.UNKNOWN} - classes_seen
    if missing:
        print(f"the cases never showed classes {missing}")
        failed += 1
    print(f"self-test: {'passed' if not failed else f'{failed} FAILED'}")
    return 1 if failed else 0
