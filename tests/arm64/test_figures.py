"""What counts as the same figures on two machines."""

import copy
from typing import Any

import pytest

from tests.arm64.figures import MOST_PX, MOST_SIGMAS, differences

FIGURES: dict[str, Any] = {
    "pairs": [[1.0, 2.0, 0.1], [3.0, 4.0, 0.2]],
    "checks": {"scale-axial": [0.5, 0.1], "latency": [float("nan"), 2.0], "no-picture": [0.0, 0.0]},
    "verdicts": ["NOT_VERIFIED"] * 10 + ["OK"] * 10,
}


def other(*path: Any, value: Any) -> dict[str, Any]:
    """The same figures but for what lies there."""
    told = place = copy.deepcopy(FIGURES)
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    return told


def test_the_same_is_the_same() -> None:
    assert differences(FIGURES, FIGURES) == ([], {"px": 0, "rad": 0, "sigmas": 0, "verdicts": 0})


@pytest.mark.parametrize(
    ("path", "value", "same"),
    [
        (("pairs", 1, 0), 3 + 0.9 * MOST_PX, True),
        (("pairs", 1, 0), 3 + 1.1 * MOST_PX, False),
        (("pairs", 0, 2), 0.101, False),
        (("pairs", 0, 2), float("nan"), False),
        (("checks", "scale-axial"), [0.5 + 0.09 * MOST_SIGMAS, 0.1], True),
        (("checks", "scale-axial"), [0.5 + 0.11 * MOST_SIGMAS, 0.1], False),
        (("checks", "scale-axial"), [0.5, 0.12], False),
        (("checks", "latency"), [0.0, 2.0], False),
        (("checks", "no-picture"), [1e-9, 0.0], True),
        (("checks", "no-picture"), [1.0, 0.0], False),
        (("checks", "more"), [1.0, 0.0], False),
        (("verdicts", 9), "OK", True),
        (("verdicts", slice(7, 10)), ["OK"] * 3, False),
        (("verdicts", slice(19, None)), [], False),
    ],
)
def test_what_is_further_apart_than_stated_is_told(path: tuple[Any, ...], value: Any, same: bool) -> None:
    assert (differences(FIGURES, other(*path, value=value))[0] == []) is same
