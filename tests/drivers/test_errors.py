"""An error's words are its own cause, never that of another error with the same number."""

import errno
import os
import socket
import ssl

import pytest

from probewatch.drivers.errors import cannot_listen, system_words


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.EADDRINUSE, "error while attempting to bind"), os.strerror(errno.EADDRINUSE)),
        (socket.gaierror(socket.EAI_NONAME, "Name or service not known"), "name or service not known"),
        (ssl.SSLCertVerificationError(1, "certificate verify failed: self-signed"), "certificate verify failed"),
        (ssl.SSLError(1, "[SSL] wrong version number"), "wrong version number"),
    ],
)
def test_an_error_is_told_in_its_own_words(error: OSError, said: str) -> None:
    assert said.lower() in system_words(error).lower()


def test_an_address_that_is_none_is_told_once() -> None:
    with pytest.raises(OSError) as failed:  # noqa: PT011  which one depends on the resolver
        socket.create_server(("256.0.0.1", 0))
    told = cannot_listen(failed.value, "--listen 256.0.0.1:0", "Choose another address")
    assert "attempting" not in told.what
    assert told.what.startswith("cannot listen there (")
    assert told.what.count("(") == told.what.count(")") == 1
