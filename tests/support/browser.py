"""Debian's Chromium, as people use it."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Page, sync_playwright

from tests.support.polling import until

CHROMIUM = shutil.which("chromium")


@contextmanager
def chromium() -> Iterator[Browser]:
    """Without a sandbox, as root has none."""
    with sync_playwright() as playwright:
        options = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=options)
        yield browser
        browser.close()


def begins(page: Page, wanted: str) -> None:
    """A busy machine loses a device for a moment, and the service refuses; a person tries again."""

    def there() -> bool:
        if page.is_visible("#begin-form"):
            page.click("#begin-form button")
        page.wait_for_timeout(500)
        return page.get_attribute("body", "data-phase") == wanted

    until(there, 60, 0.5, lambda: page.inner_text("body"))
