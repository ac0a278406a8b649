#!/usr/bin/env python3
"""Compares our reader of recordings with independent ones, scan by scan and bit by bit.

    pip install rosbags mcap mcap-ros2-support
    cargo build -p recording --example dump_scans
    tests/independent/compare_recordings.py target/debug/examples/dump_scans RECORDING...

A ROS 1 bag is read by `rosbags`, an MCAP file by `rosbags` and by `mcap-ros2-support`. Exit code 0 if
all agree on count, log time, stamp, geometry and every range; 1 with the first difference if not.
"""

import struct
import subprocess
import sys
from pathlib import Path


def line(topic, log_ns, stamp, angle_min, angle_increment, range_min, range_max, ranges):
    """What dump_scans prints, without the number of the message."""
    geometry = [f"{struct.unpack('<Q', struct.pack('<d', v))[0]:016x}"
                for v in (angle_min, angle_increment, range_min, range_max)]
    packed = struct.pack(f"<{len(ranges)}f", *ranges)
    bits = "".join(f"{word:08x}" for (word,) in struct.iter_unpack("<I", packed))
    return " ".join([topic, str(log_ns), str(stamp), *geometry, bits])


def by_rosbags(path):
    from rosbags.highlevel import AnyReader
    with AnyReader([path]) as reader:
        wanted = [c for c in reader.connections if c.msgtype == "sensor_msgs/msg/LaserScan"]
        for connection, log_ns, raw in reader.messages(connections=wanted) if wanted else []:
            m = reader.deserialize(raw, connection.msgtype)
            stamp = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
            ranges = m.ranges.view("<u4")  # numpy keeps the bits, struct may quiet a NaN
            head = line(connection.topic, log_ns, stamp, m.angle_min, m.angle_increment,
                        m.range_min, m.range_max, [])
            yield head + "".join(f"{word:08x}" for word in ranges.tolist())


def by_mcap_ros2(path):
    from mcap_ros2.reader import read_ros2_messages
    for item in read_ros2_messages(str(path)):
        if item.schema.name != "sensor_msgs/msg/LaserScan":
            continue
        m = item.ros_msg
        stamp = m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
        yield line(item.channel.topic, item.log_time_ns, stamp, m.angle_min, m.angle_increment,
                   m.range_min, m.range_max, m.ranges)


def ours(dump, path):
    output = subprocess.run([dump, path], check=True, capture_output=True, text=True).stdout
    for text in output.splitlines():
        topic, _, rest = text.split(" ", 2)
        yield f"{topic} {rest}"


def compare(dump, path):
    found = sorted(ours(dump, path))
    readers = [by_rosbags, by_mcap_ros2] if path.suffix == ".mcap" else [by_rosbags]
    same = True
    for reader in readers:
        expected = sorted(reader(path))
        if found == expected:
            print(f"same      {len(found):6} scans  {reader.__name__:12}  {path.name}")
            continue
        same = False
        print(f"DIFFERENT {len(found):6} scans, expected {len(expected)}  {reader.__name__}  {path}")
        pairs = [(f, e) for f, e in zip(found, expected) if f != e]
        for f, e in pairs[:1]:
            print(f"  found    {f[:400]}\n  expected {e[:400]}")
    return same


def main():
    dump, *paths = sys.argv[1:]
    results = [compare(dump, Path(path)) for path in paths]
    if not results:
        sys.exit(__doc__)
    sys.exit(0 if all(results) else 1)


main()
