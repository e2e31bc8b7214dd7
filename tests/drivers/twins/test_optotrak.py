"""The simulated Optotrak server: what it says, who it drops, and that it is a process of its own."""

import json
import signal
import socket
import struct
import subprocess
import time

import numpy as np
import pytest

from probewatch.drivers.clock.host_clock import HostClock
from probewatch.drivers.registry import open_tracker as open_by_url
from probewatch.drivers.trackers.optotrak.rtc3d import (
    ByteOrder,
    PacketType,
    Text,
    decode_packet,
    encode_packet,
    packet_length,
)
from probewatch.drivers.twins.scene.world import World
from tests.support.simulated import PROBEWATCH
from tests.support.simulated_optotrak import bench, poses


def said(line: socket.socket, text: str, kind: PacketType, nul: bool = True) -> list[Text]:
    """Packets up to the first of that kind."""
    line.sendall(encode_packet(Text(PacketType.COMMAND, text, nul), ByteOrder.BIG))
    found, data = [], b""
    while True:
        while (length := packet_length(data)) is None or len(data) < length:
            more = line.recv(4096)
            assert more
            data += more
        found.append(decode_packet(data[:length], ByteOrder.BIG))
        data = data[length:]
        if isinstance(found[-1], Text) and found[-1].kind is kind:
            return found


def test_the_server_speaks_as_the_fact_sheet_says() -> None:
    with bench() as cart, socket.create_connection(cart.twin.address) as line:
        line.settimeout(5)
        assert said(line, "version 1.0", PacketType.COMMAND, nul=False)[0].terminated is False
        assert said(line, "Version 1.0", PacketType.COMMAND)[0].terminated is True
        assert "not understood" in said(line, "Dance", PacketType.ERROR)[0].text
        assert "not understood" in said(line, "", PacketType.ERROR)[0].text
        assert "not understood" in said(line, "StreamFrames Frequency:0", PacketType.ERROR)[0].text
        assert "not understood" in said(line, "StreamFrames AllFrames 5D", PacketType.ERROR)[0].text
        assert "<Body>" in said(line, "SendParameters All", PacketType.XML)[1].text
        said(line, "StreamFrames FrequencyDivisor:2 All", PacketType.COMMAND)
        said(line, "StreamFrames Stop", PacketType.COMMAND)
        said(line, "Bye", PacketType.COMMAND)
        assert line.recv(100) == b""


def test_a_client_that_sends_nonsense_is_dropped_and_others_stay() -> None:
    with bench() as cart, cart.open() as tracker:
        with socket.create_connection(cart.twin.address) as line:
            line.settimeout(5)
            line.sendall(struct.pack(">II", 3, 1))
            with pytest.raises((ConnectionResetError, AssertionError)):
                assert line.recv(100) != b""
        poses(tracker, 3)


def test_the_twin_is_a_process_of_its_own() -> None:
    origin_ns = time.monotonic_ns()
    command = [*PROBEWATCH, "simulate", "optotrak", "--tcp", "0", "--origin-ns", str(origin_ns)]
    command += ["--seed", "4", "--schedule", '[{"fault": "slide-marker", "from_s": 1e6}]']
    twin = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert twin.stdout is not None
        ready = json.loads(twin.stdout.readline())
        with open_by_url(ready["url"], HostClock(origin_ns=origin_ns)) as tracker:
            pose = tracker.read(5.0)
        assert pose is not None
        np.testing.assert_allclose(pose.matrix, World(4).measured_pose(pose.sequence / 100, pose.sequence), atol=1e-3)
        twin.send_signal(signal.SIGTERM)
        _, errors = twin.communicate(timeout=10)
        assert (twin.returncode, errors) == (0, "")
    finally:
        twin.kill()
        twin.communicate()
