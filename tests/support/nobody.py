"""What a user without rights is told: a command runs in a process that may do nothing which its files do not grant."""

import ctypes
import os
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from click.testing import CliRunner

from probewatch.tools.cli import probewatch

NOBODY = 65534


@contextmanager
def open_folder() -> Iterator[Path]:
    """A folder that everybody may look into; those of pytest are for one user alone. Root's rights count in none."""
    folder = Path(tempfile.mkdtemp(prefix="probewatch-nobody-"))
    folder.chmod(0o755)
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def without_rights(work: Callable[[], str], another_user: bool = False) -> str:
    """What `work` returns where files grant and refuse as they do to any user. Of root that is a child without
    capabilities, which still finds its own programs; another_user: it is nobody besides, and can import nothing more.
    """
    if os.geteuid() != 0:
        return work()
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            if another_user:
                os.setresuid(NOBODY, NOBODY, NOBODY)
            _drop_capabilities()
            said = work()
        except BaseException:
            said = traceback.format_exc()
        with os.fdopen(writer, "wb") as stream:
            stream.write(said.encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        said = stream.read().decode()
    os.waitpid(child, 0)
    return said


def _drop_capabilities() -> None:
    """As capset(2) does with empty sets: version 3 of its header, this process, two times three words."""
    header, data = (ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()
    assert ctypes.CDLL(None, use_errno=True).capset(header, data) == 0, os.strerror(ctypes.get_errno())


def told(*words: object) -> str:
    """Exit code, the exception's class, and all that the command said, to a user without rights."""

    def work() -> str:
        result = CliRunner().invoke(probewatch, [str(word) for word in words])
        return f"{result.exit_code} {type(result.exception).__name__}: {result.exception} {result.output}"

    return without_rights(work)
