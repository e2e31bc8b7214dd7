"""Writes docs/pictures/status.svg, the moving picture of the README: `python -m
probewatch.tools.development.status_film`.

It starts the simulated cart of `probewatch demo`, asks the service for its status twice a second, bends the marker body
once the calibration is verified, and draws what `probewatch status --watch` shows, at the pace at which it came.
"""

import io
import re
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.text import Text

from probewatch.appliance.types import State
from probewatch.drivers.twins.faults import Episode, Schedule
from probewatch.tools.shared.status_view import Status, StatusView
from probewatch.tools.simulators.whole_cart import CartSettings, NotReady, SimulatedCart

PICTURE = Path(__file__).parents[2] / "docs" / "pictures" / "status.svg"
LARGEST_BYTES = 1_000_000
"""Bytes of the picture: a page on a slow line waits some seconds for it. Less leaves too few pictures for half a
minute."""
_FAULT = "bend-marker"
_EVERY_S = 0.5
"""Seconds of the cart between two pictures: a change is seen as it comes. Half of it doubles the file."""
_STEADY_S = 3.0
"""Seconds for which a state lasts before the run goes on, time to read it."""
_LEAD_S = 0.3
"""Seconds from an order to its effect, as in the demo's director."""
_RATE = 0.25
"""Seconds of the cart per second: a computer that also does other things keeps up. The picture has the cart's pace."""
_LONGEST_S = 60.0
"""Seconds of the run, on the cart's clock. A healthy one takes 15 s; a computer that is too busy gets an error, no
picture."""
_COLUMNS = 96
"""Columns of the terminal: two columns of checks fit."""
_NAMES = {
    "before": "the hand makes the gesture",
    "healthy": "every check was shown, the contact is closed",
    "bent": "the marker body is bent by 5°",
}
_FRAME = "{styles}|||{backgrounds}{matrix}"
_CELL_PX, _LINE_PX, _MARGIN_PX = 12.2, 24.4, 16.0
"""Pixels in rich's pictures of a terminal: a character's width, a line's height; and the space about them."""


@dataclass(frozen=True, slots=True)
class Look:
    """Represents one status at t_s, seconds of the cart, and what was going on."""

    t_s: float
    caption: str
    status: Status


def run(cart: SimulatedCart) -> Iterator[Look]:
    """Yields looks at the cart until it has halted for a while. Raises NotReady when that takes too long."""
    caption, since_s, last = "before", 0.0, None
    while cart.now_s() < _LONGEST_S:
        cart.require_alive()
        t_s, status = cart.now_s(), cart.status()
        if status and status["fps"]["video"] > 0:
            state = State(status["state"])
            since_s, last = (since_s if state is last else t_s), state
            caption = "healthy" if caption == "before" and state is State.MONITORING else caption
            yield Look(t_s, _NAMES[caption], status)
            steady = t_s - since_s >= _STEADY_S
            if caption == "bent" and state is State.HALT and steady:
                return
            if caption == "healthy" and state is State.MONITORING and steady:
                caption = "bent"
                cart.show_faults(Schedule((Episode(_FAULT, cart.now_s() + _LEAD_S),)))
        time.sleep(_EVERY_S / _RATE)
    raise NotReady(f"no halt within {_LONGEST_S:g} s", "simulated cart", "Try again when the machine is less busy")


def film(looks: Sequence[Look]) -> str:
    """Returns an SVG that shows one look after the other, each for as long as it lasted, again and again.

    looks: in the order of time. The last one stays for as long as a steady state does. A viewer who asked for less
    motion, and a program that shows none, sees the last one alone.
    """
    view = StatusView()
    drawn = [_drawn(look, view) for look in looks]
    lines = max(count for _, count in drawn)
    width, height = _COLUMNS * _CELL_PX + 2 * _MARGIN_PX, lines * _LINE_PX + 2 * _MARGIN_PX
    ends_s = [*(look.t_s for look in looks[1:]), looks[-1].t_s + _STEADY_S]
    whole_s = ends_s[-1] - looks[0].t_s
    frames = []
    for number, (text, _) in enumerate(drawn):
        shown = [(one - looks[0].t_s) / whole_s for one in (looks[number].t_s, ends_s[number])]
        frames.append(f'<g class="f" style="animation-name:s{number}">{text}</g>{_keyframes(number, *shown)}')
    return "\n".join((_head(width, height, whole_s), *frames, "</g></svg>", ""))


def _drawn(look: Look, view: StatusView) -> tuple[str, int]:
    """Returns one terminal as SVG, and the number of its lines."""
    stream = io.StringIO()
    console = Console(record=True, width=_COLUMNS, file=stream, force_terminal=True, highlight=False)
    console.print(Text(f"$ probewatch status --watch      # {look.t_s:.1f} s: {look.caption}", style="dim"))
    console.print(view.picture(look.status))
    lines = stream.getvalue().count("\n")
    styles, _, body = console.export_svg(code_format=_FRAME, unique_id="t").partition("|||")
    for name, style in re.findall(r"\.t-(r\d+) \{ ([^}]*) \}", styles):
        body = body.replace(f'class="t-{name}"', f'style="{style.strip()}"')
    body = re.sub(r' clip-path="[^"]*"| shape-rendering="crispEdges"|<text[^>]*></text>', "", body)
    return "".join(line.strip() for line in body.splitlines()), lines


def _keyframes(number: int, begins: float, ends: float) -> str:
    """Returns the animation that shows a picture between begins and ends alone. begins, ends: shares of the whole."""
    before = "0%{visibility:hidden}" if begins > 0 else ""
    after = "" if ends >= 1 else f"{100 * ends:.2f}%{{visibility:hidden}}"
    return f"<style>@keyframes s{number}{{{before}{100 * begins:.2f}%{{visibility:visible}}{after}}}</style>"


def _head(width_px: float, height_px: float, whole_s: float) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width_px:.0f} {height_px:.0f}" role="img">\n'
        "<title>probewatch status: not verified, monitoring after the gesture, then halt with the fault</title>\n"
        "<style>.f{visibility:hidden;animation:"
        f"{whole_s:.1f}s step-end infinite;font:20px 'DejaVu Sans Mono',Menlo,Consolas,monospace}}"
        ".f:last-of-type{visibility:visible}@media(prefers-reduced-motion:reduce){.f{animation:none}}</style>\n"
        f'<rect width="100%" height="100%" rx="8" fill="#292929"/>'
        f'<g transform="translate({_MARGIN_PX:g},{_MARGIN_PX:g})">'
    )


def main() -> None:
    """Runs the cart, writes the picture, and prints its size."""
    with (
        tempfile.TemporaryDirectory(prefix="probewatch-", ignore_cleanup_errors=True) as folder,
        SimulatedCart(Path(folder), CartSettings(rate=_RATE)) as cart,
    ):
        text = film(tuple(run(cart)))
    PICTURE.write_text(text, encoding="utf-8")
    print(f"{PICTURE}: {len(text.encode())} bytes, {LARGEST_BYTES} at most")


if __name__ == "__main__":
    main()
