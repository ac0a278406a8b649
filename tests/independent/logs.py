#!/usr/bin/env python3
"""Independent readers of logs: CARMEN, Player, CSV, ROS 2 bags in SQLite (LaserScan, MultiEcho).

    logs.py make DIRECTORY      writes a log of every kind, with everything odd that real ones have
    logs.py read FILE [ECHO]    prints the scans of a log; a directory: the files of its metadata.yaml

Written from the descriptions of the formats, with the standard library of Python alone: sqlite3, csv,
gzip, struct, decimal. A scan is a line: topic, log time (ns), stamp (ns), geometry (angle_min,
angle_increment, range_min, range_max: the bits of the f64 of the f32) and the bits of the ranges.
Every NaN is 7fc00000. A scan that cannot be used is "refused".
"""

import csv
import gzip
import math
import random
import sqlite3
import struct
import sys
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

NAN = float("nan")
INF = float("inf")


def f32(value):
    """The nearest f32, as a float."""
    try:
        return struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(INF, value)


def nanoseconds(text, unit=10**9):
    """Decimal text in a unit of so many ns, exactly."""
    return int((Decimal(text) * unit).to_integral_value(ROUND_HALF_UP))


def line(topic, log_ns, stamp_ns, geometry, ranges):
    numbers = [struct.pack(">d", f32(value)).hex() for value in geometry]
    bits = ["7fc00000" if math.isnan(r) else struct.pack(">f", f32(r)).hex() for r in ranges]
    return " ".join([topic, str(log_ns), str(stamp_ns), *numbers, "".join(bits)])


# --- SICK codes: (the number of ..F7, step), codes by their distance from it

SICK = [(Decimal("81.83"), Decimal("0.01")), (Decimal("32.759"), Decimal("0.001")),
        (Decimal("16.375"), Decimal("0.001")), (Decimal("8.183"), Decimal("0.001"))]
MEANING = {0: INF, 3: NAN, 4: NAN, 6: NAN, 7: NAN, 8: INF}


def sick_value(text, mode):
    """What a number means in a mode: a range, inf or nan."""
    if mode is not None and text not in ("inf", "nan"):
        steps = (Decimal(text) - mode[0]) / mode[1]
        if steps == int(steps) and int(steps) in MEANING:
            return MEANING[int(steps)]
    return float(text)


def sick_mode(highest):
    for mode in SICK:
        steps = (highest - mode[0]) / mode[1]
        if steps == int(steps) and int(steps) in MEANING:
            return mode
    return None


# --- CARMEN


def open_text(path):
    return gzip.open(path, "rt") if path.read_bytes()[:2] == b"\x1f\x8b" else open(path)


def carmen_fields(words):
    """(start, step, maximum) or None, the ranges as text, the two stamps."""
    kind, rest = words[0], words[1:]
    config = None
    if kind.startswith(("RAWLASER", "ROBOTLASER")):
        config = (float(rest[1]), float(rest[3]), float(rest[4]))
        rest = rest[7:]
    count = int(rest[0])
    ranges, rest = rest[1:1 + count], rest[1 + count:]
    return config, ranges, rest[-3], rest[-1]


def carmen(path):
    with open_text(path) as log:
        lines = [text.split() for text in log]
    scans = [words for words in lines if words and words[0].rstrip("12345") in
             ("FLASER", "RLASER", "RAWLASER", "ROBOTLASER")]
    highest = {}
    for words in scans:
        for text in carmen_fields(words)[1]:
            if text not in ("inf", "nan"):
                highest[words[0]] = max(highest.get(words[0], Decimal(0)), Decimal(text))
    for words in scans:
        config, ranges, stamp, logger = carmen_fields(words)
        stamp_ns = nanoseconds(stamp) or nanoseconds(logger)
        if stamp_ns == 0:
            yield "refused"
            continue
        top = highest[words[0]]
        mode = sick_mode(top)
        limit = float(mode[0]) if mode else 50.0 if Decimal(50) <= top <= Decimal("51.2") else 81.83
        if config is None:
            field, step = {180: (180, 1), 181: (180, 1), 360: (180, 0.5), 361: (180, 0.5),
                           400: (100, 0.25), 401: (100, 0.25)}.get(
                len(ranges), (180, 180 / max(len(ranges) - 1, 1)))
            start, step = math.radians(-field / 2), math.radians(step)
        else:
            start, step, declared = config
            limit = min(limit, declared) if mode else declared
        values = [sick_value(text, mode) for text in ranges]
        yield line(words[0], stamp_ns, stamp_ns, (start, step, 0.02, limit), values)


# --- Player


def player(path):
    declared = {8.192: SICK[3], 16.384: SICK[2], 32.768: SICK[1], 81.92: SICK[0]}
    with open_text(path) as log:
        for text in log:
            words = text.split()
            if text.startswith("#") or len(words) < 7 or words[3] != "laser" or int(words[5]) != 1:
                continue
            rest = {1: words[8:], 2: words[11:]}.get(int(words[6]))
            if rest is None:
                yield "refused"
                continue
            low, _, step, top = map(float, rest[:4])
            pairs = rest[5:]
            assert int(rest[4]) * 2 == len(pairs)
            mode = declared.get(top)
            values = [sick_value(text, mode) for text in pairs[::2]]
            limit = float(mode[0]) if mode else top
            stamp_ns = nanoseconds(words[0])
            topic = f"{words[2]}:laser:{int(words[4])}"
            yield line(topic, stamp_ns, stamp_ns, (low, step, 0.02, limit), values)


# --- CSV with the columns that `make` declares


def csv_rows(path):
    with open(path, newline="") as file:
        rows = csv.reader(file)
        next(rows)
        for row in rows:
            stamp_ns = nanoseconds(row[0], 10**6)
            while row and row[-1] == "":
                row.pop()
            values = [NAN if text == "" else float(text) / 1000 for text in row[4:]]
            geometry = (float(row[2]) * (math.pi / 180), 0.5 * (math.pi / 180), 0.02, 8.0)
            yield line(row[1], stamp_ns, stamp_ns, geometry, values)


# --- ROS 2 bags in SQLite


class Cdr:
    """Reads plain little-endian CDR."""

    def __init__(self, data):
        assert data[:2] == b"\x00\x01"
        self.data, self.at = data[4:], 0

    def word(self, kind):
        self.at = (self.at + 3) // 4 * 4
        (value,) = struct.unpack_from("<" + kind, self.data, self.at)
        self.at += 4
        return value

    def string(self):
        length = self.word("I")
        self.at += length
        return self.data[self.at - length:self.at - 1].decode()

    def floats(self):
        return [self.word("f") for _ in range(self.word("I"))]


def decoded(data, message_type, echo):
    cdr = Cdr(data)
    stamp_ns = cdr.word("i") * 10**9 + cdr.word("I")
    cdr.string()
    angle_min, _, step, _, _, low, top = [cdr.word("f") for _ in range(7)]
    if message_type.endswith("/LaserScan"):
        values = cdr.floats()
    else:
        beams = [cdr.floats() for _ in range(cdr.word("I"))]
        powers = [cdr.floats() for _ in range(cdr.word("I"))]
        values = []
        for number, beam in enumerate(beams):
            power = powers[number] if number < len(powers) else []
            best = {"first": 0, "last": -1}.get(echo)
            if best is None:
                best = max(range(len(power)), key=lambda i: (power[i], -i)) if power else 0
            values.append(beam[best] if beam else NAN)
    return stamp_ns, (angle_min, step, low, top), values


def db3(path, echo):
    bag = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    query = """SELECT name, type, timestamp, data FROM messages JOIN topics
               ON topics.id = topic_id WHERE type LIKE '%LaserScan' ORDER BY messages.id"""
    for topic, message_type, log_ns, data in bag.execute(query):
        stamp_ns, geometry, values = decoded(data, message_type, echo)
        yield line(topic, log_ns, stamp_ns or log_ns, geometry, values)


# --- logs to read


def cdr_scan(stamp_ns, beams, echoes):
    head = struct.pack("<iI", stamp_ns // 10**9, stamp_ns % 10**9)
    head += struct.pack("<I", 6) + b"laser\0" + b"\0\0"
    head += struct.pack("<7f", -1.5, 1.5, 0.25, 0.0, 0.1, 0.05, 9.0)
    sequence = lambda floats: struct.pack(f"<I{len(floats)}f", len(floats), *floats)
    if not echoes:
        return b"\0\1\0\0" + head + sequence([b[0] for b in beams]) + sequence([])
    body = b"".join(struct.pack("<I", len(beams)) + b"".join(map(sequence, part))
                    for part in (beams, [[r * 3 % 1 for r in b] for b in beams]))
    return b"\0\1\0\0" + head + body


def make_db3(path, first, echoes):
    bag = sqlite3.connect(path)
    bag.executescript("""
        CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
            serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
        CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
            timestamp INTEGER NOT NULL, data BLOB NOT NULL);
        CREATE INDEX timestamp_idx ON messages (timestamp ASC);""")
    kind = "sensor_msgs/msg/MultiEchoLaserScan" if echoes else "sensor_msgs/msg/LaserScan"
    topics = [(1, "/front", kind, "cdr", ""), (2, "/odom", "nav_msgs/msg/Odometry", "cdr", ""),
              (3, "/rear", kind, "cdr", "")]
    bag.executemany("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", topics)
    for number in range(first, first + 40):
        stamp_ns = 1_700_000_000_123_456_789 + number * 10**8
        count = lambda: random.randrange(4) if echoes else 1
        beams = [[random.uniform(0, 10) for _ in range(count())] for _ in range(13)]
        if not echoes:
            beams[number % 13] = [random.choice([INF, -INF, NAN, 0.0])]
        data = b"junk" if number % 3 == 1 else cdr_scan(stamp_ns * (number % 20 > 0), beams, echoes)
        row = (number % 3 + 1, stamp_ns + 5, data)
        bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    bag.commit()


def make(directory):
    random.seed(4)
    reading = lambda codes: random.choice(codes) if random.random() < 0.1 else (
        f"{random.uniform(0, 8):.3f}")
    out = ["# message formats defined: PARAM SYNC ODOM FLASER RLASER TRUEPOS", "PARAM a 1 host 0"]
    for number in range(60):
        stamp = f"{1048880434 + number / 5:.6f}"
        kind = ("FLASER", "RLASER", "ROBOTLASER1", "RAWLASER2")[number % 4]
        count = (180, 361, 90, 20)[number % 4]
        codes = [["81.83", "81.91", "81.87", "0.00"], ["51.1", "50.5", "0.01"],
                 ["32.767", "32.763", "32.759", "32.76"], ["8.5", "inf"]][number % 4]
        ranges = " ".join(reading(codes) for _ in range(count))
        out.append(f"ODOM 1 2 0.5 0 0 0 {stamp} host {number}.5")
        if number % 4 < 2:
            text = f"{kind} {count} {ranges} 1 2 3 4 5 6 {stamp if number % 8 else 0} host {number}.25"
        else:
            config = f"{kind} 4 -1.0 2.0 0.0225 {32.0 if number % 4 == 2 else 8.0} 0.01 0"
            poses = "1 2 3 4 5 6 0.1 0.2 0.3 0.4 0 " if number % 4 == 2 else ""
            text = f"{config} {count} {ranges} 1 77 {poses}{stamp} host {number}.25"
        out.append(text)
    text = "\n".join(out) + "\n"
    (directory / "carmen.log").write_text(text)
    (directory / "carmen.log.gz").write_bytes(gzip.compress(text.encode()))
    out = ["## Player version 3.0.2 ", "## File version 0.3.0 ", "## Format: ",
           "0000000000.000 16777343 6665 laser 00 004 001 +0.000 +0.000 +0.000 0.15 0.15"]
    for number in range(60):
        top, codes = [("+8.1920", ["8.191", "8.183", "8.187"]), ("+30.0000", ["30.0", "0.0"])][number % 2]
        pairs = " ".join(f"{reading(codes)} {number % 8:2d}" for _ in range(91))
        subtype = 2 if number % 6 == 1 else 1
        pose = "+1.000 +2.000 +0.500 " if subtype == 2 else ""
        out.append(f"{1000 + number / 75:014.3f} 16777343 6665 laser {number % 2:02d} 001 {subtype:03d} "
                   f"{number:04d} {pose}-1.5708 +1.5708 +0.0349 {top} 0091 {pairs} ")
        out.append(f"{1000 + number / 75:014.3f} 16777343 6665 position2d 00 001 001 +1 +2 +0.5 0 0 0 0")
    (directory / "player.log").write_text("\n".join(out) + "\n")
    with open(directory / "scans.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["Time [ms]", "Sensor, name", "Start [deg]", "Comment", "Distances [mm]"])
        for number in range(60):
            values = [random.choice(["", "inf", str(random.randrange(9000)), f"{random.uniform(0, 9e3):.4f}"])
                      for _ in range(21 if number % 2 else 17)]
            stamp = f"{1700000000000 + number * 40}.{random.randrange(10**6):06d}"
            rows.writerow([stamp, ("north, upper", "s\"2")[number % 2], -45, "x,y", *values])
    bag = directory / "bag"
    bag.mkdir()
    make_db3(bag / "b_1.db3", 40, False)
    make_db3(bag / "b_0.db3", 0, False)
    (bag / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n"
        "  relative_file_paths:\n    - b_0.db3\n    - b_1.db3\n  message_count: 80\n")
    make_db3(directory / "echo.db3", 0, True)


def read(path, echo):
    if path.is_dir():
        text = (path / "metadata.yaml").read_text().split("relative_file_paths:\n")[1]
        names = [name.strip()[2:] for name in text.splitlines() if name.startswith("    - ")]
        return [scan for name in names for scan in db3(path / name, echo)]
    if path.suffix == ".db3":
        return list(db3(path, echo))
    if path.suffix == ".csv":
        return list(csv_rows(path))
    with open_text(path) as log:
        is_player = log.read(2) == "##"
    return list(player(path) if is_player else carmen(path))


def main():
    match sys.argv[1:]:
        case ["make", directory]:
            make(Path(directory))
        case ["read", path, *echo]:
            print("\n".join(read(Path(path), *(echo or ["first"]))))
        case _:
            sys.exit(__doc__)


main()
