"""A picture becomes another while the contact is closed: it opens within a second, and stays open."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import product

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.supervision.timeline import Timeline
from probewatch.appliance.types import State
from probewatch.drivers.samples import Frame, GreyImage
from probewatch.tools.study.outcome import closed_share
from probewatch.tools.study.samples import Conditions, rendered, samples, stamp_ns
from probewatch.tools.study.session import Session
from tests.support.picture_breaks import BREAKS, Break, Other, faded

FPS, BREAKS_S, OPEN_WITHIN_S, ENDS_S = 30, 8.0, 1.0, 11.0
"""The gesture has ended two seconds before."""
HOLD, SWEEP, GESTURE = "gesture-hold", "gesture-elevational-5", "gesture-in-plane"
NOT_A_BREAK = Break(Other())
TRIED = [
    *product([HOLD], BREAKS),
    *product([SWEEP], [".2 s of black, then zoomed", "one torn picture, then zoomed", "an animated zoom"]),
    *product([SWEEP], ["mirrored in a fade of .27 s", "moved on the screen in a fade of .6 s"]),
    *product([GESTURE], [".2 s of black, then mirrored", "zoomed about a region of interest"]),
]


@lru_cache(maxsize=3)
def pictures(session: Session) -> list[GreyImage]:
    return rendered(session, None)


def windowed(image: GreyImage) -> GreyImage:
    """Returns the picture as a narrow array is shown: black on both sides of the middle three fifths."""
    shown, side = image.copy(), image.shape[1] // 5
    shown[:, :side] = shown[:, -side:] = 0
    return shown


def noisy_window(image: GreyImage) -> GreyImage:
    """Returns the same under white noise of 4 grey levels, on the black as well."""
    shown = windowed(image)
    noise = np.random.default_rng(int(shown.sum())).normal(0.0, 4.0, shown.shape)
    return np.asarray(np.clip(shown + noise, 0, 255), np.uint8)


def closed_s(
    name: str, seed: int, happening: Break, screen: Callable[[GreyImage], GreyImage] | None = None
) -> tuple[bool, float]:
    """Whether the contact was closed when it happened, and for how long it was later than a second after. screen: draws
    each picture, before and after the break, onto the screen.
    """
    session = Session(name, "still", seed, ENDS_S)
    conditions = Conditions(session)
    line = Line(session.reference, conditions.judging.limits)
    timeline = Timeline(stamp_ns(0.0), stamp_ns(0.0), stamp_ns(ENDS_S), conditions.judging)
    first = round(BREAKS_S * FPS)
    for sample in samples(conditions, pictures(session)):
        shown = sample
        if isinstance(sample, Frame):
            image = happening.shown(pictures(session), sample.sequence, first)
            shown = replace(sample, image=image if screen is None else screen(image))
        timeline.step(shown, line.step(shown))
    timeline.finish()
    changes = timeline.changes
    before = next(change for change in reversed(changes) if change.t_s < BREAKS_S)
    open_s = BREAKS_S + happening.lasting / FPS + OPEN_WITHIN_S
    then = [change for change in changes if change.t_s <= open_s][-1]
    later = [replace(then, t_s=open_s), *(change for change in changes if change.t_s > open_s)]
    shares = closed_share([replace(change, t_s=change.t_s - open_s) for change in later], ENDS_S - open_s)
    return before.state is State.MONITORING, shares * (ENDS_S - open_s)


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "what"), TRIED)
def test_a_broken_picture_opens_the_contact_within_a_second_and_for_good(name: str, what: str) -> None:
    assert closed_s(name, 1, BREAKS[what]) == (True, 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "zoom", "lasting"), [(3, 1.1, 0), (5, 1.06, 0), (3, 1.07, 4), (1, 0.93, 0)])
def test_so_does_one_that_is_stretched_in_a_window_without_a_fan(seed: int, zoom: float, lasting: int) -> None:
    """Held, it stayed closed to the end: the edges of the window stood still, and layers are alike along them."""
    assert closed_s(HOLD, seed, Break(Other(zoom=(zoom, 1.0)), lasting=lasting), windowed) == (True, 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [3, 5])
def test_so_does_one_that_fades_into_a_stretched_one_there(seed: int) -> None:
    """Tissue keeps its volume, so that a stretch to the sides alone is the scanner's. It stayed closed to the end."""
    assert closed_s(HOLD, seed, Break(Other(zoom=(1.1, 1.0)), faded, 6), windowed) == (True, 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize(("seed", "zoom"), [(1, (1.0, 1.06)), (2, (1.055, 1.0)), (3, (1.0, 0.94)), (5, (1.055, 1.0))])
def test_so_does_a_small_stretch_that_fades_in_under_noise(seed: int, zoom: tuple[float, float]) -> None:
    """Tissue goes through what lies between, even where it gives way to a press. It stayed closed to the end."""
    assert closed_s(HOLD, seed, Break(Other(zoom=zoom), faded, 6), noisy_window) == (True, 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("screen", [windowed, noisy_window])
def test_a_window_alone_opens_nothing(screen: Callable[[GreyImage], GreyImage]) -> None:
    was_closed, later_s = closed_s(HOLD, 3, NOT_A_BREAK, screen)
    assert was_closed
    assert later_s == pytest.approx(ENDS_S - BREAKS_S - OPEN_WITHIN_S, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3, 4])
@pytest.mark.parametrize("name", [HOLD, SWEEP, GESTURE, "gesture-mixed"])
@pytest.mark.parametrize("what", BREAKS)
def test_it_does_in_each_motion_and_with_each_seed(name: str, what: str, seed: int) -> None:
    assert closed_s(name, seed, BREAKS[what]) == (True, 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "lasting"), [(HOLD, 6), (SWEEP, 3), (GESTURE, 3), ("gesture-mixed", 1)])
def test_a_picture_that_is_the_same_after_a_blank_keeps_it_closed(name: str, lasting: int) -> None:
    was_closed, later_s = closed_s(name, 1, replace(NOT_A_BREAK, lasting=lasting))
    assert was_closed
    assert later_s == pytest.approx(ENDS_S - BREAKS_S - lasting / FPS - OPEN_WITHIN_S, abs=0.1)
