"""Builds what all pages share: one file, its style, its tables, and pictures and plots inside it."""

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2

from probewatch.drivers.files.atomic_file import PAGE_BEGINS, PAGE_ENDS, check_kind, check_replaceable, writing
from probewatch.drivers.samples import GreyImage
from probewatch.tools.shared.tables import figures_in

_ALLOWED = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
"""Content-Security-Policy: whatever a file or a device may have put into the text, the page loads and runs nothing."""
_STYLE = """
:root { color-scheme: light dark; font: 15px/1.5 system-ui, sans-serif;
  --text: #1c1b1f; --ground: #fff; --faint: #e4e4e4; --soft: #555; --a: #2f6fab; --b: #c77c11; --bad: #b3261e;
  --good: #2e7d32; --wait: #00838f; --warn: #b98900; }
@media (prefers-color-scheme: dark) { :root { --text: #e8e6ea; --ground: #16151a; --faint: #34323a; --soft: #aaa;
  --a: #7db4ea; --b: #f0ae52; --bad: #ff8a80; --good: #81c784; --wait: #4dd0e1; --warn: #ffd54f; } }
@page { size: A4; margin: 15mm; }
@media print { :root { color-scheme: light; } body { margin: 0; }
  h2, .note { break-after: avoid; } img + .note { break-before: avoid; }
  tr, table, svg, img { break-inside: avoid; } }
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: var(--text); background: var(--ground); }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid var(--faint); text-align: left; }
th.figure, td.figure { text-align: right; } td.figure { white-space: nowrap; }
td.bad { color: var(--bad); font-weight: 600; }
td.good { color: var(--good); } .note { color: var(--soft); } .verdict { font-size: 1.3rem; font-weight: 600; }
.good { color: var(--good); } .bad { color: var(--bad); } .wait { color: var(--wait); } .warn { color: var(--warn); }
svg, img { max-width: 100%; height: auto; } svg text { font-size: 12px; fill: var(--text); }
svg text.tick { text-anchor: middle; fill: var(--soft); } svg text.left { text-anchor: end; }
svg text.label { text-anchor: middle; fill: var(--soft); }
svg .grid { stroke: var(--faint); } svg .limit { stroke: var(--bad); stroke-dasharray: 6 4; }
svg polyline { fill: none; stroke-width: 1.5; }
svg polyline.a { stroke: var(--a); } svg polyline.b { stroke: var(--b); }
svg text.a { fill: var(--a); } svg text.b { fill: var(--b); } svg .band { opacity: .22; }
svg .band.a { fill: var(--a); } svg rect.good { fill: var(--good); } svg rect.bad { fill: var(--bad); }
svg rect.wait { fill: var(--wait); } svg rect.warn { fill: var(--warn); } svg rect.a { fill: var(--a); }
"""


def check_page(path: Path | None) -> None:
    """Raises ConfigurationError where no page can be written under that name. None means no file."""
    check_kind(path, "HTML", *PAGE_ENDS)
    check_replaceable(path, PAGE_BEGINS)


def write_page(path: Path, title: str, parts: Iterable[str], language: str = "en") -> None:
    """Writes one HTML file that loads nothing from anywhere, with its text in that language. Raises ConfigurationError
    where it cannot be written.
    """
    head = (
        f"{PAGE_BEGINS.decode()}<html lang={language}><head><meta charset=utf-8><title>{html.escape(title)}</title>"
        '<meta name=viewport content="width=device-width">'
        f'<meta http-equiv="Content-Security-Policy" content="{_ALLOWED}">'
        f"<style>{_STYLE}</style></head><body><main>"
    )
    with writing(path) as stream:
        stream.write((head + "\n".join(parts) + "\n</main></body></html>\n").encode(errors="replace"))


def section(heading: str, *parts: str) -> str:
    """Returns a section with a heading of its own."""
    return f"<section><h2>{html.escape(heading)}</h2>{''.join(parts)}</section>"


def text(words: str, kind: str = "") -> str:
    """Returns a paragraph."""
    return f'<p class="{kind}">{html.escape(words)}</p>' if kind else f"<p>{html.escape(words)}</p>"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Returns a table, its figures on the right. A cell that begins with "!" is marked as wrong, one with "+" as right,
    unless that is the sign of a figure.
    """
    cells = [tuple(row) for row in rows]
    figures = figures_in(cells) or (False,) * len(heads)
    named = zip(heads, figures, strict=True)
    head = "".join(f"<th scope=col{' class=figure' * figure}>{html.escape(one)}</th>" for one, figure in named)
    body = "".join("<tr>" + "".join(map(_cell, row, figures)) + "</tr>" for row in cells)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def picture(image: GreyImage, alt: str) -> str:
    """Returns a picture inside the page. image: (h, w) or (h, w, 3) BGR, uint8."""
    done, png = cv2.imencode(".png", image)
    assert done
    data = base64.b64encode(png.tobytes()).decode()
    return f'<img alt="{html.escape(alt, quote=True)}" src="data:image/png;base64,{data}">'


def _cell(said: str, figure: bool) -> str:
    mark = {"!": "bad", "+": "" if said[1:2].isdigit() else "good"}.get(said[:1], "")
    kinds = [kind for kind in ("figure" * figure, mark) if kind]
    names = f' class="{" ".join(kinds)}"' if kinds else ""
    return f"<td{names}>{html.escape(said[1:] if mark else said)}</td>"
