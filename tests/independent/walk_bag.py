"""Reads a ROS 1 bag (format 2.0 or 1.2) record by record, without its index.

For bags that rosbags refuses: their index is damaged or unusual, or they are of version 1.2.
Source: the ROS wiki's pages "Bags/Format/2.0" and "Bags/Format/1.2". The messages themselves are
decoded by rosbags.
"""

import bz2
import struct
from pathlib import Path

import lz4.frame
from rosbags.typesys import Stores, get_typestore

MAGICS = (b"#ROSBAG V2.0\n", b"#ROSRECORD V1.2\n")
OP_MESSAGE, OP_INDEX, OP_CHUNK, OP_CONNECTION = b"\x02", b"\x04", b"\x05", b"\x07"
UNPACK = {b"none": bytes, b"bz2": bz2.decompress, b"lz4": lz4.frame.decompress}


def fields_of(header):
    """Fields of a record header: name -> bytes."""
    fields, at = {}, 0
    while at < len(header):
        (length,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        fields[name.decode()] = value
        at += 4 + length
    return fields


def records(data, at=0):
    """Yields (fields, data) of the records; says so if the end cuts one off, and stops there."""
    while at < len(data):
        start = at
        header, at = sized(data, at)
        fields = fields_of(header)
        body, end = sized(data, at)
        if fields.get("op") == OP_INDEX and "conn" in fields:
            # Version 2.0. An index entry has 12 bytes. Old recorders counted 20 and wrote 12.
            end = at + 4 + 12 * struct.unpack("<I", fields["count"])[0]
        if end > len(data):
            print(f"the record at byte {start} is cut off by the end ({len(data)} bytes)")
            return
        at = end
        yield fields, body


def sized(data, at):
    """Bytes behind their length (u32), and where they end."""
    length = int.from_bytes(data[at : at + 4], "little")
    return data[at + 4 : at + 4 + length], at + 4 + length


def scans(path, message_type):
    """(topic, message) of all messages of a type, in the order of their receive times."""
    data = Path(path).read_bytes()
    magic = next((magic for magic in MAGICS if data.startswith(magic)), None)
    if magic is None:
        raise ValueError(f"{path}: starts with {data[:16]!r}, one of {MAGICS} expected")
    store, topics, found = get_typestore(Stores.ROS1_NOETIC), {}, []
    short_name = message_type.replace("/msg/", "/").encode()

    def take(fields, body):
        op = fields["op"]
        if op == OP_CHUNK:
            for inner in records(UNPACK[fields["compression"]](body)):
                take(*inner)
        elif op == OP_CONNECTION and fields_of(body)["type"] == short_name:
            topics[fields["conn"]] = fields["topic"].decode()
        elif op == OP_MESSAGE and "conn" not in fields:  # version 1.2
            if fields["type"] == short_name:
                seconds, nanoseconds = struct.unpack("<II", fields["sec"] + fields["nsec"])
                found.append(((seconds, nanoseconds), fields["topic"].decode(), body))
        elif op == OP_MESSAGE and fields["conn"] in topics:
            seconds, nanoseconds = struct.unpack("<II", fields["time"])
            found.append(((seconds, nanoseconds), topics[fields["conn"]], body))

    for record in records(data, len(magic)):
        take(*record)
    for _, topic, body in sorted(found, key=lambda f: f[0]):
        yield topic, store.deserialize_ros1(body, message_type)
