#!/usr/bin/env python3
"""Scans and frames of an area on the host where it runs, from shared memory: the package iceoryx2 and
nothing of tog. Run it as the user that runs tog.

    pip install iceoryx2==0.10.0          the very version that tog was built with
    python3 watch_memory.py /run/tog/SITE AREA

Prints a line of JSON for every scan and every frame. Layouts: protocol/src/scan.rs, frame.rs, wire.rs.
"""
import ctypes
import json
import sys

import iceoryx2 as iox2


def header(name, **fields):
    """A header as Rust lays it out: the common envelope, then its own fields."""
    envelope = dict(seq="Q", session="Q", source="I", flags="I", published_mono_ns="Q")
    types = {"Q": ctypes.c_uint64, "I": ctypes.c_uint32, "d": ctypes.c_double}
    layout = [(key, types[kind]) for key, kind in (envelope | fields).items()]
    of = dict(_fields_=layout, type_name=staticmethod(lambda: name))
    return type(name.split(".")[1], (ctypes.Structure,), of)


SCAN = header(
    "tog.ScanHeader.v1", stamp_ns="Q", device_stamp_ns="Q", angle_min_rad="d", angle_increment_rad="d",
    range_min_m="d", range_max_m="d",
)
FRAME = header(
    "tog.FrameHeader.v1", number="Q", period_ns="Q", lasers_present="Q", completed_by_mono_ns="Q",
    columns="I", rows="I",
)


def open_topic(node, topic, head, element):
    service = node.service_builder(iox2.ServiceName.new(topic))
    service = service.publish_subscribe(iox2.Slice[element]).user_header(head).open()
    return service.subscriber_builder().create()


def samples(subscriber, element):
    """Header and payload of all that came, as copies."""
    while (sample := subscriber.receive()) is not None:
        # Not payload().len(): that counts bytes (iceoryx2 issue 1533).
        length = sample.header.number_of_elements
        payload = bytes((element * length).from_address(sample.payload_ptr))
        head = sample.user_header().contents
        yield {key: getattr(head, key) for key, _ in head._fields_}, payload
        sample.delete()


def main(run_dir, area):
    iox2.set_log_level(iox2.LogLevel.Error)
    try:
        with open(f"{run_dir}/instance.json") as file:
            instance = json.load(file)
    except OSError as error:
        sys.exit(f"{error}: expected the run directory of a running site, as `tog doctor SITE` names it")
    config = iox2.config.default()
    config.global_cfg.root_path = iox2.Path.new(f"{run_dir}/x/")
    config.global_cfg.prefix = iox2.FileName.new(instance["prefix"])
    # The supervisor sweeps up after processes that died; nobody else does.
    config.global_cfg.service.cleanup_dead_nodes_on_open = False
    config.global_cfg.node.cleanup_dead_nodes_on_creation = False
    config.global_cfg.node.cleanup_dead_nodes_on_destruction = False
    node = iox2.NodeBuilder.new().config(config).create(iox2.ServiceType.Ipc)
    try:
        scans = open_topic(node, f"scan/{area}", SCAN, ctypes.c_float)
        frames = open_topic(node, f"frame/{area}", FRAME, ctypes.c_uint64)
    except (iox2.PublishSubscribeOpenError, RuntimeError) as error:
        sys.exit(f"nothing of {area}: {error}: is it an area of this host, and is this the user that runs tog?")
    # Wakes when a frame comes, which is when its scans have come.
    bell = node.service_builder(iox2.ServiceName.new(f"frame/{area}")).event().open()
    bell = bell.listener_builder().create()
    while True:
        for name, subscriber, element in [("scan", scans, ctypes.c_float), ("frame", frames, ctypes.c_uint64)]:
            for head, payload in samples(subscriber, element):
                print(json.dumps({name: head, "payload": payload.hex()}), flush=True)
        bell.timed_wait(iox2.Duration.from_millis(1000))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except KeyboardInterrupt:
        pass
