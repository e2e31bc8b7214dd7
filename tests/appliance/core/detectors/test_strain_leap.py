"""Strain of the pictures of a rest: what leaps, and what tissue does."""

from collections.abc import Callable

import numpy as np
import pytest

from probewatch.appliance.core.detectors.strain_leap import LastingStrain, Strain, StrainLeap

LOOK_S, LEAST = 1 / 6, 0.035


def strain(look: int, across: float, down: float, pressed: float = 0.0) -> Strain:
    return Strain(round(look * LOOK_S * 1e9), np.array([across, down]), np.array([pressed, 0.0]))


def first_told(of: Callable[[float], tuple[float, ...]], looks: int = 60) -> int | None:
    """The first look at which a leap is told. of: s since the rest began to strain across, down, and press."""
    leap = StrainLeap(LEAST)
    leap.begin(0)
    return next((k for k in range(1, looks) if leap.step(strain(k, *of(k * LOOK_S)))), None)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("between", [0, 1, 2])
def test_a_leap_is_told_at_the_third_look_that_is_steady(axis: int, sign: int, between: int) -> None:
    def leaping(t_s: float) -> tuple[float, ...]:
        share = float(np.clip((t_s / LOOK_S - 12) / (between + 1), 0, 1))
        return tuple(sign * 0.05 * share * np.eye(2)[axis])

    assert first_told(leaping) == 12 + between + 1 + 2


def test_one_that_comes_soon_after_the_rest_has_begun_is_as_well() -> None:
    assert first_told(lambda t: (0.0, 0.05 * (t > 0.25))) == 4


def test_a_small_one_is_none() -> None:
    assert first_told(lambda t: (0.0, 0.03 * (t > 2.0))) is None


@pytest.mark.parametrize("power", [2, 4, 6])
@pytest.mark.parametrize("every_s", [3.0, 4.0, 6.0])
def test_a_breath_is_none(every_s: float, power: int) -> None:
    """The higher the power, the longer it rests breathed out, and the quicker it is."""
    assert first_told(lambda t: (-0.05, 0.15 * np.cos(np.pi * t / every_s) ** power), 120) is None


def test_what_the_face_pressed_meanwhile_is_none() -> None:
    assert first_told(lambda t: (-0.03, 0.05 * (t > 2.0), 0.05 * (t > 2.0))) is None


def test_no_press_explains_a_stretch_of_the_width_alone() -> None:
    assert first_told(lambda t: (0.05 * (t > 2.0), 0.0, 0.05 * (t > 2.0))) == 15


def test_a_rest_that_begins_anew_amid_a_leap_hides_none_of_it() -> None:
    """As soon as a picture is unlike the first of a rest, it is the first of another."""
    leap = StrainLeap(LEAST)
    leap.begin(0)
    assert not leap.step(strain(1, 0.0, 0.0))
    half = strain(2, 0.0, 0.025)
    assert not leap.step(half)
    leap.go_on(half)
    assert [leap.step(strain(k, 0.0, 0.025)) for k in range(3, 6)] == [False, False, True]


def lasts(of: Callable[[float], tuple[float, ...]], looks: int = 60) -> list[bool]:
    """Whether the strain is one that lasts, look by look."""
    lasting = LastingStrain(LEAST)
    return [lasting.step(strain(k, *of(k * LOOK_S))) for k in range(looks)]


def test_a_strain_that_no_press_explains_lasts() -> None:
    assert lasts(lambda t: (0.0, 0.05 * (t > 2.0)))[20:] == [True] * 40


def test_a_tremor_that_presses_to_and_fro_ends_none() -> None:
    assert all(lasts(lambda t: (0.0, 0.055 * (t > 2.0), 0.03 * np.sin(5 * t)))[30:])


def test_one_that_a_press_explains_does_not_last() -> None:
    assert not any(lasts(lambda t: (0.0, 0.05 * (t > 2.0), 0.05 * (t > 2.0))))


def test_a_press_that_strained_nothing_before_explains_none() -> None:
    assert all(lasts(lambda t: (0.0, 0.05 * (t > 2.0), 0.05))[20:])


def test_one_that_a_breath_takes_back_ends() -> None:
    told = lasts(lambda t: (0.0, 0.15 * np.sin(np.pi * t / 4.0) ** 2))
    assert True in told[:12]
    assert not all(told[k] for k in range(12, 24))


def test_a_look_that_measured_none_ends_it() -> None:
    lasting = LastingStrain(LEAST)
    assert lasting.step(strain(1, 0.0, 0.05))
    assert not lasting.step(None)
