"""Prints a page as PDF with the browser that Debian has, so that users who do not want PDF need to install nothing."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.atomic_file import check_kind, check_replaceable, writing

_PDF_BEGINS = b"%PDF-"
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_TIMEOUT_S = 60
"""Seconds for a page to be printed: 2 s on a computer with nothing else to do, and many times that on a busy one."""


def check_pdf(path: Path | None) -> None:
    """Raises ConfigurationError where no browser can print it, the name is of another kind of file, or it would replace
    a file of another kind; None means no file.
    """
    check_kind(path, "PDF", ".pdf")
    check_replaceable(path, _PDF_BEGINS)
    if path is not None and _browser() is None:
        raise ConfigurationError("needs the program chromium", str(path), "Install it: apt install chromium")


def write_pdf(page: Path, path: Path) -> None:
    """Prints a page into a PDF. page: HTML. Raises ConfigurationError where it cannot be printed or written."""
    browser = _browser()
    assert browser is not None
    with tempfile.TemporaryDirectory(prefix="probewatch-pdf-") as folder:
        printed = Path(folder) / "page.pdf"
        command = [browser, "--headless", "--disable-gpu", "--disable-dev-shm-usage", "--no-pdf-header-footer"]
        command += [f"--user-data-dir={folder}", f"--print-to-pdf={printed}", page.absolute().as_uri()]
        if os.geteuid() == 0:
            command.insert(1, "--no-sandbox")  # browsers refuse root otherwise; the page may load and run nothing
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=_TIMEOUT_S)
            content = printed.read_bytes()
        except (OSError, subprocess.SubprocessError) as error:
            what = f"could not be printed by {browser} ({type(error).__name__})"
            raise ConfigurationError(what, str(path), "Open the page in a browser and print it there") from None
    with writing(path) as stream:
        stream.write(content)


def _browser() -> str | None:
    return next((found for name in _BROWSERS if (found := shutil.which(name))), None)
