#!/usr/bin/env python3
"""Events and class maps of a site on other machines, with the package eclipse-zenoh and nothing of tog.

    pip install eclipse-zenoh==1.10.2
    python3 listen.py SITE ground@tcp/10.20.0.10:7447=lobby,store upper@tcp/10.20.0.20:7447=office

SITE is the `name` of the site file; then the hosts that are to be heard, each with its endpoint and the
areas whose class maps are wanted. Prints a line of JSON for every event and every class map. With
transport = "tls" the endpoints begin with tls/, and this program needs the certificate of another host:
--tls /etc/tog/tls desk (see `tog certs`). Each host has a session of its own, and keys have no wildcards:
access is granted key by key, and who asks for more is told of as an intruder.

Layout: 8 bytes of envelope (`TG`, kind, version, length), then postcard: integers are varints, floats
little endian, texts and lists have their length before them (protocol/src/codec.rs, carried.rs, link.rs).
"""
import argparse
import json
import os
import struct
import sys
import threading

# zenoh 1.10 does not bear it to read and write a TLS link from two threads (its issue 2557).
os.environ.setdefault("ZENOH_RUNTIME", "(rx: (handover: tx))")
import zenoh

KINDS = """unusual_activity loitering object_left object_missing door_held_open crowd laser_silent laser_stuck
laser_blocked laser_blinded laser_moved coverage_lost process_restarted storage_fault""".split()
STATES = "raised updated cleared".split()
CLASS_SYMBOLS = 17


class Body:
    """What is behind the envelope of a message of this kind and version."""

    def __init__(self, message, kind, version):
        if message[:4] != bytes([ord("T"), ord("G"), kind, version]):
            raise ValueError(f"another message than of kind {kind} version {version}: {message[:4]!r}")
        self.bytes, self.at = message[8:], 0

    def take(self, length):
        self.at += length
        return self.bytes[self.at - length : self.at]

    def number(self):
        value = shift = 0
        while True:
            byte = self.take(1)[0]
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    def text(self):
        return self.take(self.number()).decode()

    def floats(self, count):
        return struct.unpack(f"<{count}d", self.take(8 * count))


def events(message):
    """The changes of a page of a host's journal, as they happen; none in a mere sign of life."""
    body = Body(message, 6, 2)
    host, _epoch, _after, _head = body.text(), body.number(), body.number(), body.number()
    for _ in range(body.number()):
        change = {"host": host, "journal_id": body.number(), "origin": body.text()}
        change |= {"sequence": body.number(), "id": body.text()}
        change |= {"kind": KINDS[body.number()], "state": STATES[body.number()]}
        change |= {"stamp_ns": body.number(), "first_evidence_ns": body.number(), "area": body.text()}
        change["zone"] = body.text() if body.number() else None
        change["x_m"], change["y_m"], *change["bounds_m"], _, _ = body.floats(8)
        body.number()  # whether the threshold was extrapolated
        change["text"] = body.text()
        yield change


class ClassMaps:
    """The class maps of one stream; 255 is unknown. None until the first key frame, at most a second."""

    def __init__(self):
        self.ids, self.last = None, None

    def take(self, message):
        body = Body(message, 11, 1)
        _host, area, _content = body.text(), body.text(), body.number()
        session, seq, number, period_ns = (body.number() for _ in range(4))
        _lasers, _context, _classes, columns, rows = (body.number() for _ in range(5))
        is_key = body.number()
        if not is_key and self.last != (session, seq - 1):
            self.ids = None
        self.last = (session, seq)
        if is_key:
            self.ids = bytearray(columns * rows)
        if self.ids is None:
            return None
        cell = 0
        for _ in range(body.number()):
            count, symbol = divmod(body.number(), CLASS_SYMBOLS)
            begin, cell = (cell if is_key else cell + count), cell + count + 1
            self.ids[begin:cell] = bytes([(symbol - 1) % 256]) * (cell - begin)
        return {"area": area, "number": number, "stamp_ns": number * period_ns, "rows": rows} | {
            "columns": columns,
            "classes": self.ids.hex(),
        }


def host_of(text):
    host, _, rest = text.partition("@")
    endpoint, _, areas = rest.partition("=")
    if not host or not endpoint.startswith(("tcp/", "tls/")):
        expected = "HOST@tcp/ADDRESS:PORT=AREA,.. (or tls/), as ground@tcp/10.20.0.10:7447=lobby"
        raise argparse.ArgumentTypeError(f"found {text!r}, expected {expected}")
    return host, endpoint, [area for area in areas.split(",") if area]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("site")
    parser.add_argument("hosts", nargs="+", metavar="HOST@ENDPOINT=AREA,..", type=host_of)
    parser.add_argument("--tls", nargs=2, metavar=("DIR", "HOST"))
    return parser.parse_args()


def configuration(endpoint, tls):
    config = zenoh.Config()
    if tls:
        directory, host = tls
        files = {"root_ca_certificate": f"{directory}/site-ca.pem", "enable_mtls": True}
        files |= {"connect_certificate": f"{directory}/{host}.pem", "connect_private_key": f"{directory}/{host}.key"}
        config.insert_json5("transport/link/tls", json.dumps(files))
    config.insert_json5("mode", '"peer"')
    config.insert_json5("listen/endpoints", "[]")
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("scouting/multicast/enabled", "false")
    return config


def main(site, hosts, tls):
    lock, streams = threading.Lock(), {}

    def show(what):
        with lock:
            print(json.dumps(what), flush=True)

    def on_event(sample):
        for change in events(sample.payload.to_bytes()):
            show({"event": change})

    def on_classes(sample):
        shown = streams.setdefault(str(sample.key_expr), ClassMaps()).take(sample.payload.to_bytes())
        if shown:
            show({"class_map": shown})

    sessions = []
    for host, endpoint, areas in hosts:
        try:
            session = zenoh.open(configuration(endpoint, tls))
        except zenoh.ZError as error:
            sys.exit(f"no session with {host} at {endpoint}: {error}")
        session.declare_subscriber(f"tog/{site}/{host}/event/live", on_event)
        for area in areas:
            session.declare_subscriber(f"tog/{site}/{host}/classes/{area}", on_classes)
        sessions.append(session)
        print(f"listening to {host} at {endpoint}, as soon as it answers", file=sys.stderr)
    threading.Event().wait()


if __name__ == "__main__":
    try:
        main(**vars(arguments()))
    except KeyboardInterrupt:
        pass
