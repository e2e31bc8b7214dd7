"""Debian's Chromium, as people use it."""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright

from tests.support.polling import until

CHROMIUM = shutil.which("chromium")
AXE = Path(__file__).parents[1] / "data" / "axe-core" / "axe.min.js"


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


def violations(page: Page) -> list[str]:
    """Returns the accessibility faults that axe-core finds, of any impact."""
    page.evaluate(AXE.read_text())
    found = page.evaluate("axe.run().then(done => done.violations)")
    return [f"{one['id']}: {one['nodes'][0]['html'][:120]}" for one in found]


SHOWN = """() => {
  const found = [document.title], walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const box = walk.currentNode.parentElement;
    const seen = box.checkVisibility() && !["CODE", "SCRIPT"].includes(box.tagName);
    if (seen && box.closest("[lang]").lang !== "en") found.push(walk.currentNode.data.trim());
  }
  for (const one of document.querySelectorAll("[aria-label]")) if (one.checkVisibility()) found.push(one.ariaLabel);
  return found.filter(text => /[a-z]{2}/.test(text)).map(text => [text, text in GERMAN && GERMAN[text] !== text]);
}"""
"""Every text that is seen or read aloud, and whether it is English that has its German; what says that it is English,
as the words of a driver, is not among them.
"""
ENGLISH = re.compile(r"\b(the|of|is|are|and|to|with|not|for|no|by|it|from|verified|lost)\b", re.IGNORECASE)
"""Words that no German text has."""


def english_left(page: Page) -> list[str]:
    """But for the names of files."""
    return [text for text, known in page.evaluate(SHOWN) if known or ENGLISH.search(re.sub(r"/\S+", "", text))]
