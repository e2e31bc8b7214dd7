"""An error's words are its own cause, never that of another error with the same number."""

import errno
import os
import socket
import ssl

import pytest

from drivers.errors import system_words


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
