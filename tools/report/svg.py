"""Draws plots as inline SVG, in the page's own colours, light and dark."""

import html
from collections.abc import Sequence
from itertools import groupby
from math import ceil, floor, isfinite, log10

_WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 900, 64, 12, 8, 34
"""Units of the drawing: a page on a laptop's screen; the margins hold labels of 12 units."""
_MOST_POINTS = 900
"""Points of one line: more than the plot has units shows nothing more."""
_TICKS = 5
"""Approximate number of ticks on an axis."""

_ALONE = (
    "<style>svg{background:#fff}text{font:12px sans-serif;fill:#1c1b1f}text.tick,text.label{text-anchor:middle;"
    "fill:#555}text.left{text-anchor:end}.grid{stroke:#ddd}.limit{stroke:#b3261e;stroke-dasharray:6 4}"
    "polyline{fill:none;stroke-width:2}polyline.a{stroke:#2f6ea8}polyline.b{stroke:#c77d1e}polyline.bad{stroke:#b3261e}"
    "polyline.mark{stroke:#1c1b1f}polyline.c{stroke:#2e7d32}polyline.d{stroke:#7b3fa0}text.a{fill:#2f6ea8}"
    "text.b{fill:#c77d1e}text.bad{fill:#b3261e}text.c{fill:#2e7d32}text.d{fill:#7b3fa0}"
    "rect.a{fill:#9dbfdd}rect.b{fill:#f0c48c}rect.bad{fill:#b3261e}rect.mark{fill:#1c1b1f}</style>"
)
"""Style of a drawing in a file of its own, where no page gives it colours."""


def alone(drawing: str) -> str:
    """Returns a drawing of `Plot.svg` as a whole file."""
    head, rest = drawing.split(">", 1)
    return f'{head} xmlns="http://www.w3.org/2000/svg">{_ALONE}{rest}\n'


def ticks(low: float, high: float) -> list[float]:
    """Returns round numbers between the two, about five."""
    span = max(high - low, 1e-12)
    step = 10.0 ** floor(log10(span / _TICKS))
    step *= next(factor for factor in (1, 2, 5, 10) if span / (factor * step) <= _TICKS + 1)
    return [number * step for number in range(ceil(low / step - 1e-9), floor(high / step + 1e-9) + 1)]


class Plot:
    """Draws one plot. x, y: (low, high) of the axes; what is beyond is drawn at the edge. height: in units of the
    drawing. left: margin, wide enough for what `row` writes into it.
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        height: int = 220,
        left: int = _LEFT,
    ) -> None:
        self._x, self._y, self._height, self._left = _opened(x), _opened(y), height, left
        self._parts: list[str] = []
        self._names: list[tuple[str, str]] = []
        self._axes(x_label, y_label)

    def line(self, xs: Sequence[float], ys: Sequence[float], kind: str, name: str = "") -> None:
        """Draws a line, broken where a value is not finite. kind: class of the page's style."""
        run: list[str] = []
        for x, y in _thinned(xs, ys):
            if isfinite(y):
                run.append(f"{self._at_x(x):.1f},{self._at_y(y):.1f}")
            elif run:
                self._polyline(run, kind)
                run = []
        self._polyline(run, kind)
        if name:
            self._names.append((kind, name))

    def band(self, xs: Sequence[float], low: Sequence[float], high: Sequence[float], kind: str) -> None:
        """Draws a band between two lines, broken where either is not finite."""
        points = list(zip(xs, low, high, strict=True))
        for finite, run in groupby(points, lambda point: isfinite(point[1]) and isfinite(point[2])):
            if finite:
                self._polygon(list(run), kind)

    def _polygon(self, there: list[tuple[float, float, float]], kind: str) -> None:
        there = there[:: max(1, -(-len(there) // _MOST_POINTS))]
        edge = [(x, high) for x, _, high in there] + [(x, low) for x, low, _ in reversed(there)]
        points = " ".join(f"{self._at_x(x):.1f},{self._at_y(y):.1f}" for x, y in edge)
        self._parts.append(f'<polygon class="band {kind}" points="{points}"/>')

    def level(self, y: float, kind: str = "limit") -> None:
        """Draws a line across."""
        at = f"{self._at_y(y):.1f}"
        self._parts.append(f'<line class="{kind}" x1="{self._left}" x2="{_WIDTH - _RIGHT}" y1="{at}" y2="{at}"/>')

    def block(self, from_x: float, to_x: float, low: float, high: float, kind: str, title: str) -> None:
        """Draws a rectangle that shows its title under the pointer."""
        left, right = self._at_x(from_x), self._at_x(to_x)
        top, bottom = self._at_y(high), self._at_y(low)
        size = f'x="{left:.1f}" y="{top:.1f}" width="{max(right - left, 0.5):.1f}" height="{bottom - top:.1f}"'
        self._parts.append(f'<rect class="{kind}" {size}><title>{html.escape(title)}</title></rect>')

    def word(self, x: float, y: float, text: str) -> None:
        """Writes text beside a place."""
        at = f'x="{self._at_x(x) + 4:.1f}" y="{self._at_y(y) + 4:.1f}"'
        self._parts.append(f"<text {at}>{html.escape(text)}</text>")

    def row(self, y: float, text: str) -> None:
        """Writes text in the margin on the left."""
        at = f'x="{self._left - 6}" y="{self._at_y(y) + 4:.1f}"'
        self._parts.append(f'<text class="left" {at}>{html.escape(text)}</text>')

    def svg(self, title: str) -> str:
        """Returns the whole drawing, with its title for those who cannot see it."""
        name = html.escape(title, quote=True)
        legend = "".join(
            f'<text class="{kind}" x="{self._left + 8 + 150 * k}" y="{_TOP + 14}">{html.escape(text)}</text>'
            for k, (kind, text) in enumerate(self._names)
        )
        head = f'<svg role="img" aria-label="{name}" viewBox="0 0 {_WIDTH} {self._height}">'
        return f"{head}{''.join(self._parts)}{legend}</svg>"

    def _axes(self, x_label: str, y_label: str) -> None:
        bottom, right = self._height - _BOTTOM, _WIDTH - _RIGHT
        for x in ticks(*self._x):
            at = f"{self._at_x(x):.1f}"
            self._parts.append(f'<line class="grid" x1="{at}" x2="{at}" y1="{_TOP}" y2="{bottom}"/>')
            self._parts.append(f'<text class="tick" x="{at}" y="{bottom + 14}">{x:g}</text>')
        for y in ticks(*self._y) if y_label else ():
            row = self._at_y(y)
            self._parts.append(f'<line class="grid" x1="{self._left}" x2="{right}" y1="{row:.1f}" y2="{row:.1f}"/>')
            self._parts.append(f'<text class="tick left" x="{self._left - 6}" y="{row + 4:.1f}">{y:g}</text>')
        place = f'x="{(self._left + right) / 2}" y="{bottom + 28}"'
        self._parts.append(f'<text class="label" {place}>{html.escape(x_label)}</text>')
        place = f'transform="translate(14,{(_TOP + bottom) / 2:.0f}) rotate(-90)"'
        self._parts.append(f'<text class="label" {place}>{html.escape(y_label)}</text>')

    def _polyline(self, points: list[str], kind: str) -> None:
        if points:
            self._parts.append(f'<polyline class="{kind}" points="{" ".join(points)}"/>')

    def _at_x(self, x: float) -> float:
        low, high = self._x
        return self._left + (_WIDTH - self._left - _RIGHT) * min(max((x - low) / (high - low), 0), 1)

    def _at_y(self, y: float) -> float:
        low, high = self._y
        bottom = self._height - _BOTTOM
        return bottom - (bottom - _TOP) * min(max((y - low) / (high - low), 0), 1)


def _opened(span: tuple[float, float]) -> tuple[float, float]:
    low, high = span
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def _thinned(xs: Sequence[float], ys: Sequence[float]) -> list[tuple[float, float]]:
    both = list(zip(xs, ys, strict=True))
    return both[:: max(1, -(-len(both) // _MOST_POINTS))]
