"""What a technician takes to the cart fits on one printed sheet of A4, both sides, with its pictures."""

import re
from pathlib import Path

import pytest
from markdown_it import MarkdownIt

from probewatch.tools.report.pdf import write_pdf
from tests.support.browser import CHROMIUM

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium (chromium)")
DOCS = Path(__file__).parents[2] / "docs"
STYLE = """@page { size: A4; margin: 10mm } body { font: 9pt/1.25 "DejaVu Sans", sans-serif } h1 { font-size: 14pt }
h1, h2 { margin: .5em 0 .2em } h2 { font-size: 11pt } p, ul, ol, pre { margin: .3em 0 } li p { margin: 0 }
table { border-collapse: collapse; width: 100%; margin: .3em 0 }
th, td { border: .5pt solid #888; padding: 0 4pt; text-align: left }
pre, code { font-size: 8pt; white-space: pre-wrap } img { max-width: 70%; max-height: 48mm; display: block }"""
SIDES = 2


@pytest.mark.parametrize(
    ("name", "pictures"),
    [
        ("page", 2),
        ("recalibration", 1),
        ("first-calibration", 1),
        ("self-test", 1),
        ("calibrations", 1),
        ("first-day", 1),
    ],
)
def test_it_fits_on_a_sheet(tmp_path: Path, name: str, pictures: int) -> None:
    text = MarkdownIt().enable("table").render((DOCS / f"{name}.md").read_text(encoding="utf-8"))
    shown = re.findall(r'<img src="([^"]+)"', text)
    assert len(shown) >= pictures
    assert all((DOCS / one).is_file() for one in shown)
    page, printed = DOCS / f".{name}.html", tmp_path / "page.pdf"
    try:
        page.write_text(f"<!doctype html><meta charset=utf-8><style>{STYLE}</style>{text}", encoding="utf-8")
        write_pdf(page, printed)
    finally:
        page.unlink(missing_ok=True)
    assert len(re.findall(rb"/Type\s*/Page\b", printed.read_bytes())) <= SIDES
