"""A hypothesis state machine: everything that can happen to a cart, in any order, and the oracle after every tick."""

from collections.abc import Callable

import hypothesis
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, get_state_machine_test, initialize, rule

from probewatch.appliance.limits import RequiredAges
from tests.invariant.cart import Cart
from tests.invariant.circumstances import GRADUAL, SUDDEN, Blank, Circumstances, Manner, Pictures, Poses, Stamps
from tests.invariant.oracle import SHIPPED, STRICT
from tests.invariant.world import ANOTHER_ASPECT, BREAKS, CHANGES, CORNERED, NONE, Change

SPELL_S = st.sampled_from([0.5, 3.0, 3.0, 8.0, 34.0])
"""How long a disturbance lasts by itself; the longest outlasts any verification."""
SKEW_S = st.sampled_from([0.6, 5.0, 20.0, 3600.0])
CLOSED_AGAIN_WITHIN_S = 30.0
GESTURE_DEG = 1.4
"""Tilt of the gesture that is asked for once all is well. What was named as a fault must be shown within .8 of its
limit: a hand that tilts by 1.0° may need more than a minute and a half for that (sigma .75° to .9°, seed 7)."""

BAD_PICTURES = st.sampled_from([fate for fate in Pictures if fate is not Pictures.GENUINE])
BAD_POSES = st.sampled_from([fate for fate in Poses if fate is not Poses.GENUINE])
BAD_STAMPS = st.sampled_from([fate for fate in Stamps if fate is not Stamps.RIGHT])
STREAMS = st.sampled_from(["frame", "pose"])
UNSEEN = st.sampled_from([None, None, CHANGES[0], *CHANGES])
"""What changes half a second after a disturbance began; the incident more often than the rest."""

BETWEEN_S = st.sampled_from([0.04, 0.1, 0.2, 0.25, 0.3, 0.45, 0.6])
"""From the old picture to the new one: about the gap's .3 s, and up to where black is named."""
BLANK = st.builds(Blank, lasting_s=st.sampled_from([0.0, 0.0, 0.0, 0.04, 0.1, 0.2, 0.4, 0.6]), first=st.booleans())
"""Beside what else lies between the two pictures."""


class Room(RuleBasedStateMachine):
    """Disturbances end when `all_is_well_again`, may overlap until then, and hide what is changed meanwhile."""

    fps = 30.0
    done: Callable[[], None] = staticmethod(lambda: None)
    """Called after each room."""

    @initialize(
        seed=st.integers(0, 999),
        wrong=st.sampled_from([NONE, NONE, NONE, *CHANGES]),
        tilt_deg=st.sampled_from([GESTURE_DEG, GESTURE_DEG, 1.0]),  # without any two of the rotations are never shown
        seconds=st.sampled_from([7.0, 7.0, 16.0]),
        discerning=st.booleans(),
        asked=st.sampled_from([SHIPPED, STRICT]),
    )
    def switched_on(
        self, seed: int, wrong: Change, tilt_deg: float, seconds: float, discerning: bool, asked: RequiredAges
    ) -> None:
        self.cart = Cart(
            seed,
            change=wrong,
            tilt_deg=tilt_deg,
            fps=self.fps,
            attended=False,
            received=True,
            discerning=discerning,
            asked=asked,
        )
        self.body_was_moved = wrong.moves_body
        self.cart.run(seconds)

    @rule(fate=BAD_PICTURES, change=UNSEEN, seconds=SPELL_S)
    def pictures_go_bad(self, fate: Pictures, change: Change | None, seconds: float) -> None:
        self.cart.meet(pictures=fate)
        self._spell(change, seconds)

    @rule(fate=BAD_POSES, change=UNSEEN, seconds=SPELL_S)
    def poses_go_bad(self, fate: Poses, change: Change | None, seconds: float) -> None:
        self.cart.meet(poses=fate)
        self._spell(change, seconds)

    @rule(fate=BAD_STAMPS, stream=STREAMS, skew_s=SKEW_S, change=UNSEEN, seconds=SPELL_S)
    def stamps_go_bad(self, fate: Stamps, stream: str, skew_s: float, change: Change | None, seconds: float) -> None:
        self.cart.meet(**{f"{stream}_stamps": fate}, skew_ns=round(skew_s * 1e9))
        self._spell(change, seconds)

    @rule(stream=STREAMS, skew_s=SKEW_S, sign=st.sampled_from([1, 1, -1]))
    def one_stamp_is_false(self, stream: str, skew_s: float, sign: int) -> None:
        self.cart.false_stamp(stream, sign * round(skew_s * 1e9))
        self.cart.run(1.0)

    @rule(change=st.sampled_from([NONE, *CHANGES]))
    def the_truth_changes(self, change: Change) -> None:
        """Seen, where nothing hides it."""
        self._change(change)
        self.cart.run(2.0)

    @rule(
        change=st.sampled_from([NONE, *BREAKS]),
        manner=st.sampled_from(SUDDEN),
        between_s=BETWEEN_S,
        blank=BLANK,
        seconds=st.sampled_from([1.5, 3.0, 8.0]),
    )
    def the_picture_breaks(
        self, change: Change, manner: Manner, between_s: float, blank: Blank, seconds: float
    ) -> None:
        """It becomes another, or what it was."""
        self.cart.break_picture(change, manner, between_s, blank)
        self.cart.run(between_s + blank.lasting_s + seconds)

    @rule(
        change=st.sampled_from([NONE, *BREAKS, ANOTHER_ASPECT, CORNERED]),
        manner=st.sampled_from(GRADUAL),
        over_s=st.sampled_from([0.1, 0.3, 0.8, 1.2, 3.0]),
        blank=BLANK,
        seconds=st.sampled_from([1.5, 3.0, 12.0]),
    )
    def the_picture_changes_gradually(
        self, change: Change, manner: Manner, over_s: float, blank: Blank, seconds: float
    ) -> None:
        """Nothing else hides it, and the probe rests: in motion it is for motion to tell."""
        self._well()
        self.cart.meet(moving=False)
        self.cart.run(2.0)
        self.cart.break_picture(change, manner, over_s, blank)
        self.cart.run(over_s + blank.lasting_s + seconds)

    @rule(seconds=SPELL_S)
    def probe_rests(self, seconds: float) -> None:
        self.cart.meet(moving=False)
        self.cart.run(seconds)

    @rule(seconds=st.sampled_from([1.0, 5.0, 17.0]))
    def all_is_well_again(self, seconds: float) -> None:
        """What was changed stays."""
        self._well()
        self.cart.run(seconds)

    @rule(attended=st.booleans())
    def somebody_acknowledges(self, attended: bool) -> None:
        """Now, or nobody does for a while."""
        self.cart.attended = attended
        self.cart.run(1.0)

    def teardown(self) -> None:
        """e: with everything well, and the gesture made, the contact closes again."""
        if hasattr(self, "cart") and not self.cart.broken:
            self._recover()
        self.done()

    def _spell(self, change: Change | None, seconds: float) -> None:
        self.cart.run(0.5)
        if change is not None:
            self._change(change)
        self.cart.run(seconds)

    def _change(self, change: Change) -> None:
        self.body_was_moved |= change.moves_body
        self.cart.change(change)

    def _well(self) -> None:
        self.cart.meet(**{name: getattr(Circumstances(), name) for name in Circumstances.__dataclass_fields__})

    def _recover(self) -> None:
        cart, cart.attended = self.cart, True
        self._well()
        cart.tilt(GESTURE_DEG)
        cart.change(NONE)
        closed_again = cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed)
        if not closed_again and self.body_was_moved:
            cart.recalibrate()
            closed_again = cart.run(CLOSED_AGAIN_WITHIN_S, until=lambda: cart.closed)
        assert closed_again, f"(e) everything is well, but the contact stays open\n{cart.told()}"


def room_test(examples: int, steps: int, seed: int) -> Callable[[], None]:
    """A test of so many rooms of so many steps each; the same ones for the same seed.

    What fails is printed as it happened, not reduced: the journal of the cart tells it, and reducing takes minutes.
    """
    test = get_state_machine_test(
        Room,
        settings=settings(
            max_examples=examples,
            stateful_step_count=steps,
            derandomize=False,
            database=None,
            deadline=None,
            phases=[Phase.generate],
            report_multiple_bugs=False,
            suppress_health_check=list(HealthCheck),
        ),
    )
    return hypothesis.seed(seed)(test)
