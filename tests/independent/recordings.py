#!/usr/bin/env python3
"""Reads a recording of ours with the programs of others, and writes one of theirs for us.

    recordings.py decode BAG EXPECTED.json
        every message of every channel, by `rosbags` and by `mcap-ros2-support`: the same to the
        last bit, and the numbers that they should be
    recordings.py make OUT
        a bag of LaserScans, written by `rosbags`

EXPECTED.json says where the scans came from, where the results of `tog replay` lie, and how the site is.
Exit code 0 if all is right; else the first thing that is not.
"""

import json
import math
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

UNKNOWN = 255


def plain(value):
    """A message as lists, dictionaries and numbers, whoever decoded it; floats as their bits."""
    if isinstance(value, (bytes, bytearray, memoryview)):
        return list(bytes(value))
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return np.float64(value).tobytes().hex()
    if isinstance(value, (str, bool, int, np.integer)):
        return value
    names = getattr(value, "__slots__", None) or vars(value).keys()
    fields = {name: plain(getattr(value, name)) for name in names if not name.startswith("_")}
    # rosbags puts the constants of a definition into the message as well.
    return {name: v for name, v in fields.items() if not name.isupper()}


def by_rosbags(bag):
    found = defaultdict(list)
    with AnyReader([bag]) as reader:
        for connection, log_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((log_ns, message))
    return found


def by_mcap_ros2(bag):
    found = defaultdict(list)
    for file in sorted(bag.glob("*.mcap")):
        for item in read_ros2_messages(str(file)):
            found[item.channel.topic].append((item.log_time_ns, item.ros_msg))
    return found


def channels(bag):
    found, notes = set(), {}
    for file in sorted(bag.glob("*.mcap")):
        with open(file, "rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert reader.get_header().profile == "ros2"
            summary = reader.get_summary()
            for channel in summary.channels.values():
                assert channel.message_encoding == "cdr", channel
                assert summary.schemas[channel.schema_id].encoding == "ros2msg"
                found.add(channel.topic)
                notes[channel.topic] = channel.metadata
            names = {attachment.name for attachment in reader.iter_attachments()}
            assert names == {"site.toml", "calibration.json"}, names
            session = [m for m in reader.iter_metadata() if m.name == "tog.session"]
            assert len(session) == 1 and session[0].metadata["software"].startswith("tog ")
    return found, notes


def stamp_ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def both(bag):
    """All messages, after both programs agreed on every one of them."""
    one, two = by_rosbags(bag), by_mcap_ros2(bag)
    found, notes = channels(bag)
    assert set(one) == found, f"channels without a message: {found - set(one)}"
    assert set(two) == found, set(two) ^ found
    for topic in sorted(found):
        assert len(one[topic]) == len(two[topic]), topic
        pairs = zip(sorted(one[topic], key=lambda m: m[0]), sorted(two[topic], key=lambda m: m[0]))
        for (log_one, a), (log_two, b) in pairs:
            assert log_one == log_two and plain(a) == plain(b), f"{topic}: {a}\n{b}"
        print(f"same in both: {len(one[topic]):5} messages of {topic}")
    return one, notes


def check_scans(found, expected):
    for topic, source in expected["scans"].items():
        with AnyReader([Path(source["recording"])]) as reader:
            wanted = [c for c in reader.connections if c.topic == source["topic"]]
            originals = {}
            for connection, _, raw in reader.messages(connections=wanted):
                message = reader.deserialize(raw, connection.msgtype)
                originals[stamp_ns(message.header.stamp)] = message
        scans = [message for _, message in found[topic]]
        assert len(scans) == len(originals) > 0, (topic, len(scans), len(originals))
        for scan in scans:
            original = originals[stamp_ns(scan.header.stamp)]
            assert scan.ranges.tobytes() == original.ranges.tobytes()
            for field in ["angle_min", "angle_max", "angle_increment", "range_min", "range_max"]:
                assert getattr(scan, field) == getattr(original, field), field
            assert scan.header.frame_id == source["frame"]
        share = found[topic.replace("/scan", "/echo_share")]
        assert all(0 < message.data < 1 for _, message in share)
        print(f"{topic}: {len(scans)} scans, bit by bit those of {source['topic']}")


def check_geometry(message, expected, area):
    origin = message.info.origin
    assert (origin.position.x, origin.position.y) == tuple(area["origin_m"])
    assert (origin.orientation.w, origin.orientation.z) == (1.0, 0.0)
    assert message.info.resolution == np.float32(area["cell_m"])
    assert (message.info.width, message.info.height) == (area["columns"], area["rows"])
    assert message.header.frame_id == "map"


def check_maps(found, expected):
    area, replay = expected["area"], Path(expected["replay"])
    rows, columns, names = area["rows"], area["columns"], area["classes"]
    base = f"{area['prefix']}/maps/always"
    last = found[f"{base}/counts"][-1][1]
    assert [f.name for f in last.fields] == names and all(f.type == 8 for f in last.fields)
    assert last.cell_stride == 8 * len(names) and last.row_stride == last.cell_stride * columns
    assert last.column_count == columns and last.cell_size.x == last.cell_size.y == area["cell_m"]
    assert (last.pose.position.x, last.pose.position.y) == tuple(area["origin_m"])
    counts = np.frombuffer(last.data.tobytes(), "<f8").reshape(rows, columns, len(names))
    truth = np.load(replay / "collapsed_counts.npy")
    truth = truth.reshape(-1, len(names), rows, columns)[0]
    assert (np.moveaxis(counts, 2, 0) == truth).all(), "the counts are not those of tog replay"
    assert truth.sum() > 0
    totals = [[int(truth[:, r, c].sum()) for c in range(columns)] for r in range(rows)]
    for index, name in enumerate(names):
        grid = found[f"{base}/{name}"][-1][1]
        check_geometry(grid, expected, area)
        cells = np.asarray(grid.data).astype(np.uint8).reshape(rows, columns)
        for r in range(rows):
            for c in range(columns):
                total, count = totals[r][c], int(truth[index, r, c])
                wanted = (200 * count + total) // (2 * total) if total else UNKNOWN
                assert cells[r, c] == wanted, (name, r, c, cells[r, c], wanted)
    print(f"{base}: counts and percent of {len(names)} classes are those of tog replay")


def check_class_maps(found, notes, expected):
    area, replay = expected["area"], Path(expected["replay"])
    topic = f"{area['prefix']}/classes"
    numbers = {int(n): row for row, n in enumerate(np.load(replay / "frames.npy"))}
    rows = np.load(replay / "classes.npy")
    values = {int(k[len("value_"):]): area["classes"].index(v)
              for k, v in notes[topic].items() if k.startswith("value_")}
    table = np.full(256, 254, np.uint8)
    table[UNKNOWN] = UNKNOWN
    for value, identity in values.items():
        table[value] = identity
    for _, message in found[topic]:
        check_geometry(message, expected, area)
        number = stamp_ns(message.header.stamp) // area["period_ns"]
        cells = table[np.asarray(message.data).astype(np.uint8)]
        cells = cells.reshape(area["rows"], area["columns"])
        assert (cells == rows[numbers[number]]).all(), number
    print(f"{topic}: {len(found[topic])} maps are rows of classes.npy")


def check_poses(found, expected):
    for _, message in found["/tf_static"]:
        poses = {t.child_frame_id: t for t in message.transforms}
        assert set(poses) == set(expected["lasers"]), poses
        for frame, (x_m, y_m, yaw_deg) in expected["lasers"].items():
            transform = poses[frame].transform
            assert poses[frame].header.frame_id == "map"
            assert (transform.translation.x, transform.translation.y) == (x_m, y_m)
            half = math.radians(yaw_deg) / 2
            assert math.isclose(transform.rotation.z, math.sin(half), abs_tol=1e-15)
            assert math.isclose(transform.rotation.w, math.cos(half), abs_tol=1e-15)
    print(f"/tf_static: {len(expected['lasers'])} poses")


def check_events(found, expected):
    lines = (Path(expected["replay"]) / "events.jsonl").read_text().splitlines()
    changes = [json.loads(line) for line in lines]
    logs = [message for _, message in found["/events"]]
    assert len(logs) == len(changes) > 0, (len(logs), len(changes))
    is_open = {}
    for log, (_, markers), change in zip(logs, found["/events/markers"], changes):
        assert (log.msg, log.file, log.line) == (change["text"], change["id"], change["sequence"])
        assert log.name == "tog." + change["origin"] and stamp_ns(log.stamp) == change["stamp_ns"]
        levels = {"raised": {30, 40}, "updated": {20}, "cleared": {20}}
        assert log.level in levels[change["state"]], (log.level, change)
        is_open[change["id"]] = change
        gone = [is_open.pop(change["id"])] if change["state"] == "cleared" else []
        boxes = [m for m in markers.markers if m.ns == "box"]
        assert len(boxes) == len(is_open) + len(gone), boxes
        assert [m.action for m in boxes].count(2) == len(gone)
        words = {m.text for m in markers.markers if m.ns == "words" and m.action == 0}
        assert all(any(identity in text for text in words) for identity in is_open)
        for box in (m for m in boxes if m.action == 0):
            middles = {((b[0] + b[2]) / 2, (b[1] + b[3]) / 2)
                       for b in (c["bounds_m"] for c in is_open.values())}
            assert (box.pose.position.x, box.pose.position.y) in middles
    zones = found["/zones"][-1][1].markers
    assert [m.text for m in zones if m.ns == "name"] == expected["zones"]
    print(f"/events: {len(logs)} changes are those of tog replay")


def decode(bag, expected):
    found, notes = both(bag)
    check_scans(found, expected)
    check_maps(found, expected)
    check_class_maps(found, notes, expected)
    check_poses(found, expected)
    check_events(found, expected)
    print("verdict: every channel is what it should be")


def make(out):
    """100 scans of 91 beams: range of beam b of scan n is 1 + b/128 + n/1024, beam 7 has no return."""
    store = get_typestore(Stores.ROS2_JAZZY)
    scan, header = (store.types[f"{package}/msg/{name}"] for package, name in
                    [("sensor_msgs", "LaserScan"), ("std_msgs", "Header")])
    time = store.types["builtin_interfaces/msg/Time"]
    with Writer(out, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        for n in range(100):
            ns = n * 10**8
            stamp = time(sec=1767225600 + ns // 10**9, nanosec=ns % 10**9)
            ranges = (1 + np.arange(91) / 128 + n / 1024).astype(np.float32)
            ranges[7] = np.inf
            message = scan(
                header=header(stamp=stamp, frame_id="base_scan"), angle_min=-0.78125,
                angle_max=0.78125, angle_increment=0.017578125, time_increment=0.0, scan_time=0.1,
                range_min=0.125, range_max=8.0, ranges=ranges,
                intensities=np.zeros(0, np.float32))
            writer.write(topic, 1767225600 * 10**9 + ns,
                         store.serialize_cdr(message, "sensor_msgs/msg/LaserScan"))
    print(f"made {out}")


def main():
    match sys.argv[1:]:
        case ["decode", bag, expected]:
            decode(Path(bag), json.loads(Path(expected).read_text()))
        case ["make", out]:
            make(Path(out))
        case _:
            sys.exit(__doc__)


main()
