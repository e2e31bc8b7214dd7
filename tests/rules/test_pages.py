"""The pages lead somewhere, each is found from the list of pages, and those that are read whole stay short."""

import re
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.rglob("*.md")])
LONGEST_WORDS = {"README.md": 900, "docs/known-anomalies.md": 1000, "docs/method.md": 7000, "docs/study.md": 3000}
"""Two screens; some four minutes for somebody who reads every row; half of what the last two once had."""


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"^ *(?:\d+\. )?```.*?^ *```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)


def anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub makes them: no punctuation, hyphens for spaces, a number from the second alike on."""
    found: dict[str, int] = {}
    for heading in re.findall(r"^#+ (.*)$", prose(page), re.M):
        name = re.sub(r"[^\w\- ]", "", re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()).replace(" ", "-")
        found[name] = found.get(name, -1) + 1
    return {name if not number else f"{name}-{number}" for name, last in found.items() for number in range(last + 1)}


def links(page: Path) -> list[tuple[str, str]]:
    """(file, anchor) of each link within the repository; either may be empty."""
    targets = re.findall(r"\]\(([^()\s]*(?:\([^()]*\))?[^()\s]*)\)", prose(page))
    return [(one.partition("#")[0], one.partition("#")[2]) for one in targets if "://" not in one]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    lost = []
    for file, anchor in links(page):
        target = page if not file else (page.parent / unquote(file)).resolve()
        known = target.exists() and (not anchor or target.suffix != ".md" or unquote(anchor) in anchors(target))
        lost += [] if known else [f"{file}#{anchor}"]
    assert not lost


def test_every_page_is_listed() -> None:
    listed = {(DOCS / file).resolve() for file, _ in links(DOCS / "index.md") if file}
    assert {page for page in DOCS.glob("*.md") if page.name != "index.md"} <= listed


@pytest.mark.parametrize(("name", "longest"), LONGEST_WORDS.items())
def test_what_everybody_reads_is_short(name: str, longest: int) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    assert len(re.sub(r"\||-{3,}|[─┐┴┘├┤┌]", " ", text).split()) <= longest


def test_a_link_that_leads_nowhere_is_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One & two\n[a](#one--two) [b](#three) [c](gone.md)\n```\n[d](code.md)\n```\n## Same\n## Same\n")
    assert links(page) == [("", "one--two"), ("", "three"), ("gone.md", "")]
    assert anchors(page) == {"one--two", "same", "same-1"}


def test_the_steps_to_repeat_after_an_update_are_those_that_need_the_running_cart() -> None:
    """The page named the numbers of an older sheet."""
    named = re.search(r"Steps (\d+) to (\d+) of \[periodic-check", (ROOT / "docs" / "security.md").read_text())
    assert named is not None
    sheet = (ROOT / "docs" / "periodic-check.md").read_text()
    first, last = (re.search(rf"^\| {number} \| (.*?) \|", sheet, re.M) for number in named.groups())
    assert first is not None
    assert "lamp-test" in first[1]
    assert last is not None
    assert "supply off" in last[1]
