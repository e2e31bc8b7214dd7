"""Lists the states of `Evidence` and what each cause does to them (docs/method.md, What resets what)."""

from collections.abc import Callable, Mapping
from enum import StrEnum
from types import MappingProxyType


class Cause(StrEnum):
    """Names why state is discarded."""

    PICTURE_CHANGED = "picture changed"
    SIGHT_LOST = "sight lost"
    PICTURE_STAMPS = "wrong picture timestamps"
    POSE_STAMPS = "wrong pose timestamps"
    FIELD_ANSWERED = "field answered"


class State(StrEnum):
    """Names a group of values that `Evidence` keeps between pictures and always resets together."""

    SOLVING = "solution under way"
    MOTION = "motion of the windows"
    SHOWN = "**what was shown**"
    LATEST = "latest solution"
    UNCONFIRMED = "`undecided`, drift, times of faults to be confirmed, error of a point"
    SUSPECTED = "parameters that failed last"
    RESTS = "rests"
    NOISE = "noise"
    LAG = "far lag"
    TISSUE = "tissue is rigid, skin stays"
    CONTRADICTIONS = "**contradictions**, field"
    SETTLING = "time until which a change settles"
    CHANGES = "times of changes"
    SEARCHED = "time of the last search for a lag"
    POSES = "poses"
    PACE = "hand's speed"


class Effect(StrEnum):
    """Names how a cause changes a state. CUT discards values of `since_ns` or later, or dates them before it."""

    KEPT = "–"
    CUT = "newer"
    CLEARED = "cleared"
    BREATHS_KEPT = "cleared; breaths kept"


Reset = Callable[[int], object]
"""Resets one state; takes `since_ns`, which only Effect.CUT uses."""


def _row(*effects: Effect) -> Mapping[Cause, Effect]:
    return MappingProxyType(dict(zip(Cause, effects, strict=True)))


_KEPT, _CUT, _ALL, _BREATHS = Effect
RESETS: Mapping[State, Mapping[Cause, Effect]] = MappingProxyType(
    {
        State.SOLVING: _row(_ALL, _ALL, _ALL, _ALL, _KEPT),
        State.MOTION: _row(_ALL, _ALL, _CUT, _KEPT, _KEPT),
        State.SHOWN: _row(_ALL, _ALL, _CUT, _KEPT, _ALL),
        State.LATEST: _row(_ALL, _ALL, _ALL, _KEPT, _ALL),
        State.UNCONFIRMED: _row(_ALL, _ALL, _ALL, _KEPT, _KEPT),
        State.SUSPECTED: _row(_ALL, _ALL, _KEPT, _KEPT, _KEPT),
        State.RESTS: _row(_ALL, _ALL, _CUT, _CUT, _KEPT),
        State.NOISE: _row(_ALL, _BREATHS, _KEPT, _KEPT, _KEPT),
        State.LAG: _row(_ALL, _ALL, _KEPT, _KEPT, _KEPT),
        State.TISSUE: _row(_KEPT, _ALL, _KEPT, _KEPT, _KEPT),
        State.CONTRADICTIONS: _row(_KEPT, _KEPT, _CUT, _KEPT, _KEPT),
        State.SETTLING: _row(_ALL, _ALL, _CUT, _KEPT, _KEPT),
        State.CHANGES: _row(_KEPT, _KEPT, _CUT, _KEPT, _KEPT),
        State.SEARCHED: _row(_KEPT, _KEPT, _ALL, _KEPT, _KEPT),
        State.POSES: _row(_KEPT, _KEPT, _KEPT, _CUT, _KEPT),
        State.PACE: _row(_KEPT, _KEPT, _KEPT, _ALL, _KEPT),
    }
)


def reset(cause: Cause, since_ns: int, resets: Mapping[tuple[State, Effect], Reset]) -> None:
    """Resets each state as the table has it for the cause. resets: the function for each effect on a state there."""
    for state, effects in RESETS.items():
        if effects[cause] is not Effect.KEPT:
            resets[state, effects[cause]](since_ns)
