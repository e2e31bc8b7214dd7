"""The descriptor that the control socket keeps for a person, when all others have run out."""

import contextlib
import os
import resource
import socket
import threading
from pathlib import Path

import pytest

from probewatch.appliance.service.control.server import ControlServer
from tests.appliance.service.control.test_control import answered_at


def test_a_person_is_answered_when_no_descriptor_is_left(tmp_path: Path) -> None:
    """And again: the one that is kept for this comes back when the person has left."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ControlServer(tmp_path / "control") as server:
        for _ in range(3):
            with socket.socket(socket.AF_UNIX) as link, contextlib.ExitStack() as rest:
                link.connect(str(tmp_path / "control"))
                link.sendall(b'{"v": 1, "do": "status"}\n')
                used = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
                resource.setrlimit(resource.RLIMIT_NOFILE, (used + 3, before[1]))
                try:
                    with contextlib.suppress(OSError):
                        while True:
                            rest.callback(os.close, os.dup(link.fileno()))
                    assert answered_at(server, link, 5)
                finally:
                    resource.setrlimit(resource.RLIMIT_NOFILE, before)
            server.poll(lambda do, request, who: {})


def test_the_descriptor_kept_for_a_person_is_free_for_nobody_else_when_the_person_leaves(tmp_path: Path) -> None:
    """A device that is being opened again asks for one all the time."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    taken: list[int] = []

    def opening(ended: threading.Event) -> None:
        while not ended.is_set():
            with contextlib.suppress(OSError):
                taken.append(os.dup(0))

    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as rest:
        persons = [rest.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(20)]
        used = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
        resource.setrlimit(resource.RLIMIT_NOFILE, (used + 1, before[1]))
        try:
            with contextlib.suppress(OSError):
                while True:
                    rest.callback(os.close, os.dup(0))
            for person in persons:
                person.connect(str(tmp_path / "control"))
                person.sendall(b'{"v": 1, "do": "status"}\n')
                assert answered_at(server, person, 5)
                person.shutdown(socket.SHUT_RDWR)
                ended = threading.Event()
                thread = threading.Thread(target=opening, args=(ended,))
                thread.start()
                server.poll(lambda do, request, who: {})
                ended.set()
                thread.join()
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, before)
            for descriptor in taken:
                os.close(descriptor)
        assert taken == []


def test_the_descriptor_kept_for_a_person_stays_reserved_while_nobody_asks(tmp_path: Path) -> None:
    """Without a descriptor, accept() fails whether somebody waits or not."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as rest:
        used = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
        resource.setrlimit(resource.RLIMIT_NOFILE, (used + 1, before[1]))
        try:
            with contextlib.suppress(OSError):
                while True:
                    rest.callback(os.close, os.dup(0))
            server.poll(lambda do, request, who: {})
            with pytest.raises(OSError, match="Too many open files"):
                rest.callback(os.close, os.dup(0))
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, before)
