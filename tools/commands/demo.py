"""`probewatch demo`: runs a simulated cart with injected faults, from bytes to alarm."""

import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import click
from rich.console import Console

from probewatch.appliance.supervision.supervisor import LATCHED
from probewatch.appliance.types import State
from probewatch.drivers.errors import TooBusy
from probewatch.drivers.twins.scene.bedside import scanned
from probewatch.drivers.twins.scene.surroundings import RIGID
from probewatch.tools.demo.director import Director
from probewatch.tools.demo.live_view import LiveView
from probewatch.tools.demo.load import DemoLoad
from probewatch.tools.demo.outcome import History, Moment, Prompt, Switch, judge
from probewatch.tools.demo.report import Circumstances, print_report, report_fields
from probewatch.tools.demo.script import Planned, Script, chosen_plan, default_plan
from probewatch.tools.shared.fault_at import fault_at
from probewatch.tools.shared.json_report import json_option, text_aside
from probewatch.tools.shared.point_text import point_text
from probewatch.tools.shared.status_view import Status
from probewatch.tools.simulators.whole_cart import CartSettings, NotReady, SimulatedCart

_ANSWER_S = 15.0
"""Seconds without an answer of the service before the demo gives up. It answers within a tick of 50 ms, so only on a
machine that is too busy, or where the service hangs, does it take as long; less ends demos that would have gone on. Not
measured."""
_ASK_AGAIN_S = 0.5
"""Seconds of the cart between two acknowledgements. Shorter acknowledges again before the first can take effect; longer
ends later."""
_LESS_BUSY = "Try again when the machine is less busy"


def _faults(_context: click.Context, _option: click.Parameter, texts: tuple[str, ...]) -> list[tuple[str, float]]:
    return [_fault(text) for text in texts]


def _fault(text: str) -> tuple[str, float]:
    fault, from_s = fault_at(text)
    if from_s is None or not 0 <= from_s < 1e5:
        raise click.BadParameter(f"'{text}' needs a time in seconds, such as {fault}@25")
    return fault, from_s


def _tissue(_context: click.Context, _option: click.Parameter, name: str) -> str:
    scanned(name)
    return name


@click.command(name="demo")
@click.option(
    "--fault", "faults", multiple=True, callback=_faults, metavar="NAME@SECONDS", help="repeatable; see above"
)
@click.option("--duration", "duration_s", type=click.FloatRange(15, 86_400), help="end after so many seconds")
@click.option(
    "--speed", default=1.0, show_default=True, type=click.FloatRange(0.25, 4), help="simulated seconds per second"
)
@click.option(
    "--seed", default=1, show_default=True, type=click.IntRange(0), help="random seed of tissue, motion and noise"
)
@click.option("--tissue", default=RIGID, show_default=True, callback=_tissue, help="what is scanned; see below")
@click.option(
    "--openigtlink",
    "served",
    is_flag=True,
    help="serve pictures and poses to the service through an OpenIGTLink server",
)
@json_option
def command(
    faults: list[tuple[str, float]],
    duration_s: float | None,
    speed: float,
    seed: int,
    tissue: str,
    served: bool,
    as_json: bool,
) -> None:
    """Watch a simulated cart while its faults are found.

    Scanner, tracker and relay board are simulated below the protocol, by processes of their own; the service between
    them is the real one. Without options: 20 s of healthy motion, with the verification gesture: what is shown already
    and which motion shows the rest is told until the calibration is verified. Then one fault after the other, each
    removed once it has led to its last state and acknowledged as an operator would; the next comes when the hand has
    made the gesture again and the calibration is verified. Takes about two and a half minutes; Ctrl-C stops everything.

    \b
    --fault NAME@SECONDS puts your own fault in, in place of that script:
      flip-lateral, flip-vertical   the picture is mirrored          (polarity)
      depth                         the scanner zooms by 10 %        (scale)
      bend-marker                   the marker body turns by 5°      (rotation)
      slide-marker                  the marker body slips by 10 mm   (offset)
      latency                       the tracker is late by 100 ms    (latency)
      freeze-video, lose-video      the picture stops, or goes       (frozen-video, video-lost)
      lose-tracker, stale-tracker   no answer, or an old one         (tracker-lost, tracker-stale)
    It comes at that time, or as soon after it as the calibration is verified: only then can it be lost.

    --tissue NAME scans a patient instead of a phantom, such as half-30+drag-2; `probewatch study --help` lists the
    parts. The demo's pictures, 21 mm deep, are too shallow to be verified over tissue that gives way, so no fault can
    be put in there.

    \b
    Examples:
      probewatch demo --fault flip-lateral@20
      probewatch demo --fault depth@20 --fault lose-tracker@30 --json > demo.json
      probewatch demo --duration 100 --seed 7

    Exit code 0: every fault was found, rightly named and recovered from, and nothing else alarmed. 1: some was not; the
    last line says which. 69: a part of the cart died. 75: undecided, because this computer was too busy with other
    programs; try again when it is not. 78: the script is not possible, or a file cannot be used.
    """
    write_report = click.get_current_context().with_resource(text_aside(as_json))
    plan = chosen_plan(faults, duration_s) if faults else default_plan(duration_s)
    settings = CartSettings(seed, speed, served, tissue=tissue)
    console = Console(file=sys.stdout, highlight=False)
    with _stoppable() as stop:
        script, history, counters = _run(plan, duration_s, settings, console, stop)
    outcome = judge(script, history)
    print_report(console, outcome)
    write_report(report_fields(outcome, history, Circumstances(seed, speed, tissue, counters)))
    if not outcome.passed:
        sys.exit(TooBusy.exit_code if outcome.too_busy else 1)


@contextmanager
def _stoppable() -> Iterator[threading.Event]:
    """Yields an event that termination signals set, so that the program ends at a point of its own choosing."""
    stop = threading.Event()
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = {number: signal.signal(number, lambda *_: stop.set()) for number in numbers}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _run(
    plan: tuple[Planned, ...],
    duration_s: float | None,
    settings: CartSettings,
    console: Console,
    stop: threading.Event,
) -> tuple[Script, History, dict[str, int]]:
    """Returns the script, the history and the service's counters. Raises Abort when stopped, DeviceLost when a part
    dies, TooBusy where this computer was overloaded shortly before the service stopped answering.
    """
    with DemoLoad() as load:

        def pause(seconds: float) -> None:
            load.look()
            if stop.wait(seconds):
                raise click.Abort

        try:
            return _show(plan, duration_s, settings, console, pause, load)
        except NotReady as error:
            load.look()
            since_ns = time.monotonic_ns() - round(_ANSWER_S * 1e9)
            if any(until_ns > since_ns for _, until_ns in load.spans_ns):
                raise TooBusy(f"this computer is overloaded: {error.what}", error.where, _LESS_BUSY) from None
            raise


def _show(
    plan: tuple[Planned, ...],
    duration_s: float | None,
    settings: CartSettings,
    console: Console,
    pause: Callable[[float], None],
    load: DemoLoad,
) -> tuple[Script, History, dict[str, int]]:
    """Runs the demo on a simulated cart in a temporary folder, and returns what `_run` does."""
    director = Director(plan)
    view = LiveView(console, director) if console.is_terminal and not console.is_dumb_terminal else PlainView()
    with tempfile.TemporaryDirectory(prefix="probewatch-", ignore_cleanup_errors=True) as folder:
        click.echo(f"simulated cart: seed {settings.seed}, speed {settings.rate:g}")
        with SimulatedCart(Path(folder), settings, pause) as cart, view:
            operator = Operator(cart, director, view, load)
            while not operator.finished(duration_s):
                operator.look()
                pause(0.0)
            return operator.script(), operator.history(), operator.counters


class PlainView(nullcontext[None]):
    """Shows the demo without a terminal: one line per event."""

    def event(self, t_s: float, text: str, state: State | None = None) -> None:
        """Prints an event; t_s is simulated time."""
        click.echo(f"{t_s:7.2f} s  {text}")

    def show(self, t_s: float, status: Status) -> None:
        """Ignores a status: it is not an event."""


class Operator:
    """Reads the service's status once per tick, notes changes, and acknowledges a halt once its fault is removed."""

    def __init__(self, cart: SimulatedCart, director: Director, view: LiveView | PlainView, load: DemoLoad) -> None:
        self._cart, self._director, self._view, self._load = cart, director, view, load
        self._told_s = 0.0
        self._moments: list[Moment] = []
        self._switches: list[Switch] = []
        self._acknowledged_s: list[float] = []
        self._prompts: list[Prompt] = []
        self._point_mm: float | None = None
        self._told_point = False
        self._ask_s = 0.0
        self._answered_s = time.monotonic()
        self.counters: dict[str, int] = {}

    def look(self) -> None:
        """Takes a status. Raises DeviceLost when a part of the cart has died or the service does not answer."""
        self._cart.require_alive()
        status = self._cart.status()
        t_s = self._cart.now_s()
        self._tell_faults(t_s)
        if not status:
            self._wait_for_answer()
            return
        self._answered_s, self.counters = time.monotonic(), status["counters"]
        self._load.look(overloaded=status["load"]["overloaded_s"] is not None)
        self._note_state(t_s, status)
        self._note_prompt(t_s, status)
        self._note_point(t_s, status)
        if self._director.step(t_s, State(status["state"])):
            self._cart.show_faults(self._director.orders)
        self._note_contact()
        self._acknowledge(t_s, status)
        self._view.show(t_s, status)

    def finished(self, duration_s: float | None) -> bool:
        """Returns whether the time is up or, without a time limit, whether the script is complete."""
        t_s = self._cart.now_s()
        return self._director.finished(t_s) if duration_s is None else t_s >= duration_s

    def script(self) -> Script:
        """Returns the faults shown so far."""
        return self._director.script(self._cart.now_s())

    def history(self) -> History:
        """Returns the states and faults seen so far."""
        seen = tuple(self._moments), tuple(self._switches), tuple(self._acknowledged_s)
        busy_s, prompts = self._load.spans_s(self._cart.clock), tuple(self._prompts)
        return History(*seen, self._cart.now_s(), busy_s, prompts, self._point_mm)

    def _wait_for_answer(self) -> None:
        if time.monotonic() - self._answered_s > _ANSWER_S:
            raise NotReady("the service does not answer", str(self._cart.socket), _LESS_BUSY)
        time.sleep(0.02)

    def _tell_faults(self, t_s: float) -> None:
        for one in self._director.shown:
            if self._told_s < one.from_s <= t_s:
                self._view.event(one.from_s, f"FAULT {one.fault} begins, to be named {one.fault_class}")
            if self._told_s < one.to_s <= t_s:
                self._view.event(one.to_s, f"FAULT {one.fault} ends")
        self._told_s = t_s

    def _note_state(self, t_s: float, status: Status) -> None:
        state, fault = State(status["state"]), status["fault"]
        last = self._moments[-1] if self._moments else None
        if last is not None and (last.state, last.fault) == (state, fault):
            return
        entered = last is None or last.state is not state
        moment = Moment(t_s - status["since_s"] if entered else t_s, state, fault, status["reason"])
        self._moments.append(moment)
        self._view.event(moment.t_s, f"{state.value}: {f'{fault}: ' if fault else ''}{moment.reason}", state)

    def _note_prompt(self, t_s: float, status: Status) -> None:
        """Records what motion has shown already and which motion is asked for next, while the service asks for one."""
        if State(status["state"]) is not State.NOT_VERIFIED or status["fault"] is not None:
            return
        asked = sum(check["max_age_s"] is not None for check in status["checks"])
        prompt = Prompt(t_s, asked, tuple(status["missing"]), tuple(status["gesture"]))
        if asked and (not self._prompts or prompt.text != self._prompts[-1].text):
            self._prompts.append(prompt)
            self._view.event(t_s, prompt.text)

    def _note_point(self, t_s: float, status: Status) -> None:
        """Reports once after each verification how large the error of a point may be, and keeps the smallest bound."""
        point = status["point"] if State(status["state"]) is State.MONITORING else None
        if point is None:
            self._told_point = self._told_point and State(status["state"]) is State.MONITORING
            return
        if not self._told_point:
            self._told_point = True
            self._view.event(t_s, point_text(point))
        worst_mm = point["worst_mm"][1]
        self._point_mm = worst_mm if self._point_mm is None else min(self._point_mm, worst_mm)

    def _note_contact(self) -> None:
        said = [event for event in tuple(self._cart.twins["relay_board"].said) if "energised" in event]
        for event in said[len(self._switches) :]:
            t_s = (event["t_ns"] - self._cart.clock.origin_ns) / 1e9
            self._switches.append(Switch(t_s, event["energised"]))
            self._view.event(t_s, f"relay board: contact {'closed' if event['energised'] else 'opened'}")

    def _acknowledge(self, t_s: float, status: Status) -> None:
        """Acknowledges when an operator would: the cause is gone, and the pipeline reports the calibration as correct
        again.
        """
        latched = State(status["state"]) in LATCHED and status["verdict"] == "OK"
        if not latched or self._director.on(t_s) is not None or t_s < self._ask_s:
            return
        self._ask_s = t_s + _ASK_AGAIN_S
        if self._cart.acknowledge():
            self._acknowledged_s.append(t_s)
            self._view.event(t_s, "acknowledged")
