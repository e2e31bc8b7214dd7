"""The descriptor that the control socket keeps for a person, when all others have run out."""

import contextlib
import os
import resource
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from probewatch.appliance.service.control.server import ControlServer
from tests.appliance.service.control.test_control import answered_at


@contextlib.contextmanager
def no_descriptor_left() -> Iterator[None]:
    """This process can open nothing more, except by what is closed meanwhile."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = max(int(entry.name) for entry in Path("/proc/self/fd").iterdir())
    with contextlib.ExitStack() as rest:
        resource.setrlimit(resource.RLIMIT_NOFILE, (used + 1, before[1]))
        try:
            with contextlib.suppress(OSError):
                while True:
                    rest.callback(os.close, os.dup(0))
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_a_person_is_answered_when_no_descriptor_is_left(tmp_path: Path) -> None:
    """And again: the one that is kept for this comes back when the person has left."""
    with ControlServer(tmp_path / "control") as server:
        for _ in range(3):
            with socket.socket(socket.AF_UNIX) as link:
                link.connect(str(tmp_path / "control"))
                link.sendall(b'{"v": 1, "do": "status"}\n')
                with no_descriptor_left():
                    assert answered_at(server, link, 5)
            server.poll(lambda do, request, who: {})


def test_the_descriptor_kept_for_a_person_is_free_for_nobody_else_when_the_person_leaves(tmp_path: Path) -> None:
    """A device that is being opened again asks for one all the time."""
    taken: list[int] = []

    def opening(ended: threading.Event) -> None:
        while not ended.is_set():
            with contextlib.suppress(OSError):
                taken.append(os.dup(0))

    with ControlServer(tmp_path / "control") as server, contextlib.ExitStack() as rest:
        persons = [rest.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(20)]
        try:
            with no_descriptor_left():
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
            for descriptor in taken:
                os.close(descriptor)
        assert taken == []


def test_the_descriptor_kept_for_a_person_stays_reserved_while_nobody_asks(tmp_path: Path) -> None:
    """Without a descriptor, accept() fails whether somebody waits or not."""
    with ControlServer(tmp_path / "control") as server, no_descriptor_left():
        server.poll(lambda do, request, who: {})
        with pytest.raises(OSError, match="Too many open files"):
            os.close(os.dup(0))
