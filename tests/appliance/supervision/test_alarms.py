"""The alarm table is whole, fits its display and keeps to its ranges; audio and annunciator act on it."""

import itertools

import pytest

from probewatch.appliance.supervision.alarms import (
    DISPLAY_COLUMNS,
    HAZARDS,
    SIGNALS,
    Priority,
    operator_text,
)
from probewatch.appliance.supervision.annunciator import BURSTS, LAMP_TEST_NS, Annunciator, Role
from probewatch.appliance.supervision.audio import LONGEST_PAUSE_NS, REMINDER_NS, Audio, AudioMode
from probewatch.appliance.supervision.languages import GERMAN, LANGUAGES
from probewatch.appliance.types import AlarmState, Fault, Kind, State

S_NS = 1_000_000_000
MS_NS = 1_000_000
SHOWN_IN = {
    Kind.CALIBRATION: (State.WARNING, State.HALT, State.RECALIBRATION_REQUESTED, State.RECALIBRATING),
    Kind.DEVICE: (State.WARNING, State.DEVICE_LOST, State.RECALIBRATING),
    Kind.INTERNAL: (State.INTERNAL_FAULT, State.WARNING, State.RECALIBRATING),
    Kind.INTEGRITY: (State.INTERNAL_FAULT,),
    Kind.SIGHT: (State.NOT_VERIFIED,),
    Kind.ADVISORY: (),
}
"""States that name a hazard of each kind."""


def alarm(state: State, since_ns: int = 0, acknowledged: bool = False) -> AlarmState:
    return AlarmState(state, since_ns, None, "", state is State.MONITORING, None, acknowledged=acknowledged)


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("state", State)
def test_every_hazard_in_every_state_has_a_text_that_fits(state: State, language: str) -> None:
    faults = [name for name in HAZARDS if state in SHOWN_IN[name.kind]]
    for fault in (None, *faults):
        text, remedy = operator_text(state, fault, language)
        assert 0 < len(text) <= DISPLAY_COLUMNS, text
        assert 0 < len(remedy) <= DISPLAY_COLUMNS, remedy


def test_every_text_of_the_tables_is_translated() -> None:
    texts = {text for row in (*SIGNALS.values(), *HAZARDS.values()) for text in (row.text, row.remedy)}
    texts |= {row.requested for row in HAZARDS.values() if row.requested}
    assert texts <= set(GERMAN)


@pytest.mark.parametrize("fault", [fault for fault in HAZARDS if fault.kind is Kind.CALIBRATION])
def test_nobody_is_sent_to_recalibrate_what_motion_recovers(fault: Fault) -> None:
    halted, requested = (operator_text(state, fault)[1] for state in (State.HALT, State.RECALIBRATION_REQUESTED))
    assert "recalibrate" not in halted
    assert ("recalibrate" in requested) is (fault in (Fault.SCALE, Fault.OFFSET))
    assert ("calibration recover" in halted) is (fault in (Fault.ROTATION, Fault.OFFSET))


def test_every_fault_has_a_row_but_the_fact_that_never_fails() -> None:
    assert set(HAZARDS) == {*Fault} - {Fault.AGREEMENT}


def test_every_state_has_a_row() -> None:
    assert set(SIGNALS) == set(State)


def test_signals_keep_to_the_ranges_of_their_priority() -> None:
    ranges_hz = {Priority.HIGH: (1.4, 2.8), Priority.MEDIUM: (0.4, 0.8), Priority.LOW: (0, 0), Priority.NONE: (0, 0)}
    colours = {Priority.HIGH: "red", Priority.MEDIUM: "yellow", Priority.LOW: "cyan", Priority.NONE: "green"}
    pulses = {Priority.HIGH: {10}, Priority.MEDIUM: {3}, Priority.LOW: {0, 1}, Priority.NONE: {0}}
    for signal in SIGNALS.values():
        low_hz, high_hz = ranges_hz[signal.priority]
        assert low_hz <= signal.flash_hz <= high_hz
        assert signal.lamp.value == colours[signal.priority]
        assert signal.pulses in pulses[signal.priority]


def test_only_a_verified_calibration_is_green() -> None:
    assert [state for state in State if SIGNALS[state].priority is Priority.NONE] == [State.MONITORING]


@pytest.mark.parametrize("pulses", BURSTS)
def test_bursts_have_as_many_pulses_as_they_say_and_do_not_overlap(pulses: int) -> None:
    burst = BURSTS[pulses]
    assert len(burst.offsets_ms) == pulses
    assert all(b - a > burst.pulse_ms for a, b in itertools.pairwise(burst.offsets_ms))
    assert burst.period_ms == 0 or burst.period_ms > burst.offsets_ms[-1] + 2500


def heard(annunciator: Annunciator, state: AlarmState, from_ns: int, seconds: int) -> list[int]:
    """Times in ms at which the tone begins, seen at every tick."""
    sounding, starts = False, []
    for now_ns in range(from_ns, from_ns + seconds * S_NS, 50 * MS_NS):
        was, sounding = sounding, not annunciator.step(now_ns, state)[Role.TONE]
        if sounding and not was:
            starts.append((now_ns - from_ns) // MS_NS)
    return starts


@pytest.mark.parametrize(("state", "bursts"), [(State.HALT, 2), (State.WARNING, 1), (State.NOT_VERIFIED, 1)])
def test_a_tick_hears_every_pulse(state: State, bursts: int) -> None:
    assert len(heard(Annunciator(), alarm(state), 0, 12)) == bursts * SIGNALS[state].pulses


FIVE = ((0, 150), (250, 400), (500, 650), (850, 1000), (1100, 1250))
TEN = (*FIVE, *((on + 2000, off + 2000) for on, off in FIVE))
SOUNDS_MS = {
    State.HALT: (*TEN, *((on + 8000, off + 8000) for on, off in TEN)),
    State.WARNING: ((0, 200), (400, 600), (800, 1000), (15_000, 15_200), (15_400, 15_600), (15_800, 16_000)),
    State.NOT_VERIFIED: ((0, 200),),
    State.MONITORING: (),
}


@pytest.mark.parametrize("state", SOUNDS_MS)
def test_the_tone_to_the_millisecond(state: State) -> None:
    annunciator, since_ns = Annunciator(), 7_300 * MS_NS
    present = alarm(state, since_ns)
    sounding = [not annunciator.step(since_ns + ms * MS_NS, present)[Role.TONE] for ms in range(16_000)]
    wanted = [any(on <= ms < off for on, off in SOUNDS_MS[state]) for ms in range(16_000)]
    assert sounding == wanted


@pytest.mark.parametrize("state", State)
def test_energised_is_safe_for_every_role(state: State) -> None:
    """What a dead cart shows, everything de-energised, is contact open, red, yellow and cyan lit, green dark, tone."""
    shown = Annunciator().step(0, alarm(state))
    assert shown[Role.CONTACT] is shown[Role.GREEN] is (state is State.MONITORING)
    lit = {role.value for role in (Role.RED, Role.YELLOW, Role.CYAN) if not shown[role]}
    assert lit == ({SIGNALS[state].lamp.value} - {"green"})
    assert set(shown) == set(Role)


def test_the_halt_lamp_flashes_at_its_rate_and_begins_lit() -> None:
    annunciator = Annunciator()
    since_ns = 7_300 * MS_NS
    lit = [not annunciator.step(since_ns + n * 50 * MS_NS, alarm(State.HALT, since_ns))[Role.RED] for n in range(200)]
    assert lit == ([True] * 5 + [False] * 5) * 20


def test_a_lamp_test_shows_all_and_leaves_the_contact_alone() -> None:
    annunciator = Annunciator()
    annunciator.test_lamps(0)
    for state in (State.MONITORING, State.HALT):
        shown = annunciator.step(LAMP_TEST_NS - 1, alarm(state))
        assert shown[Role.CONTACT] is (state is State.MONITORING)
        assert (shown[Role.GREEN], shown[Role.RED], shown[Role.YELLOW], shown[Role.TONE]) == (True, False, False, False)
    assert annunciator.step(LAMP_TEST_NS, alarm(State.MONITORING))[Role.RED]


def test_the_times_are_those_of_the_manual() -> None:
    assert (LAMP_TEST_NS, LONGEST_PAUSE_NS, REMINDER_NS) == (5 * S_NS, 120 * S_NS, 60 * S_NS)


def test_a_pause_silences_and_ends_by_itself() -> None:
    audio = Audio()
    audio.pause(0, 60 * S_NS)
    paused = audio.step(60 * S_NS - 1, alarm(State.HALT))
    assert (paused.mode, paused.pulses, paused.until_ns) == (AudioMode.PAUSED, 0, 60 * S_NS)
    assert audio.step(60 * S_NS, alarm(State.HALT)).pulses == 10


@pytest.mark.parametrize("duration_ns", [0, -1, LONGEST_PAUSE_NS + 1])
def test_a_pause_is_bounded(duration_ns: int) -> None:
    with pytest.raises(ValueError, match="120 s"):
        Audio().pause(0, duration_ns)


def test_the_longest_pause_is_two_minutes_and_the_shortest_a_nanosecond() -> None:
    audio = Audio()
    audio.pause(0, 1)
    assert audio.step(0, alarm(State.HALT)).mode is AudioMode.PAUSED
    audio.pause(0, LONGEST_PAUSE_NS)
    assert audio.step(120 * S_NS - 1, alarm(State.HALT)).pulses == 0


@pytest.mark.parametrize("every_s", [119, 121, 179])
def test_pauses_in_a_row_remind_like_a_sound_that_is_off(every_s: int) -> None:
    """Without a reason, and without a word, the sound could be kept away for as long as somebody asked again."""
    annunciator, halted, silent, step_ns = Annunciator(), alarm(State.HALT), [], 100 * MS_NS
    for t_ns in range(0, 600 * S_NS, step_ns):
        if t_ns % (every_s * S_NS) == 0:
            annunciator.audio.on()
            annunciator.audio.pause(t_ns, LONGEST_PAUSE_NS)
        silent.append(annunciator.step(t_ns, halted)[Role.TONE])
    first, *others = (len(list(run)) for is_silent, run in itertools.groupby(silent) if is_silent)
    assert first * step_ns == LONGEST_PAUSE_NS
    assert max(others) * step_ns <= REMINDER_NS + BURSTS[10].period_ms * MS_NS, "a pause may begin between two bursts"


def test_a_reminder_says_until_when_the_sound_is_paused_and_of_one_that_is_off_why() -> None:
    audio, halted = Audio(), alarm(State.HALT)
    for begun_s in (0, 119):
        audio.pause(begun_s * S_NS, LONGEST_PAUSE_NS)
        audio.step(begun_s * S_NS, halted)
    paused = audio.step(120 * S_NS, halted)
    assert (paused.mode, paused.pulses, paused.until_ns) == (AudioMode.PAUSED, 1, 239 * S_NS)
    audio.off("the room is cleaned")
    off = audio.step(121 * S_NS, halted)
    assert (off.mode, off.until_ns, off.off_reason) == (AudioMode.OFF, None, "the room is cleaned")


def test_a_pause_after_a_minute_of_sound_is_silent_again() -> None:
    audio, halted = Audio(), alarm(State.HALT)
    for begun_s in (0, 180):
        audio.pause(begun_s * S_NS, LONGEST_PAUSE_NS)
        heard_in = [audio.step(t_s * S_NS, halted).pulses for t_s in range(begun_s, begun_s + 121)]
        assert heard_in == [0] * 120 + [10]


def test_an_acknowledged_alarm_is_silent_and_reminds() -> None:
    audio = Audio()
    halted = alarm(State.HALT, acknowledged=True)
    assert audio.step(S_NS, halted).mode is AudioMode.ACKNOWLEDGED
    assert audio.step(S_NS + REMINDER_NS - 1, halted).pulses == 0
    due = audio.step(S_NS + REMINDER_NS, halted)
    assert (due.pulses, due.since_ns) == (1, S_NS + REMINDER_NS)
    assert audio.step(S_NS + 2 * REMINDER_NS + 7, halted).since_ns == S_NS + 2 * REMINDER_NS


def test_one_reminder_is_one_pulse() -> None:
    annunciator = Annunciator()
    halted = alarm(State.HALT, acknowledged=True)
    assert len(heard(annunciator, halted, 0, 150)) == 2


@pytest.mark.parametrize("reason", ["", "  ", "x", " ab "])
def test_audio_goes_off_only_with_a_reason(reason: str) -> None:
    audio = Audio()
    with pytest.raises(ValueError, match="reason"):
        audio.off(reason)
    assert audio.step(0, alarm(State.HALT)).pulses == 10


def test_three_letters_are_a_reason() -> None:
    audio = Audio()
    audio.off("MRI")
    assert audio.step(0, alarm(State.HALT)).off_reason == "MRI"


def test_audio_off_reminds_until_it_is_on_again() -> None:
    audio = Audio()
    audio.off("service visit")
    off = audio.step(0, alarm(State.HALT))
    assert (off.mode, off.pulses, off.off_reason) == (AudioMode.OFF, 0, "service visit")
    assert audio.step(REMINDER_NS, alarm(State.HALT)).pulses == 1
    audio.on()
    assert audio.step(REMINDER_NS + 1, alarm(State.HALT)).pulses == 10


def test_a_low_priority_needs_no_reminder() -> None:
    audio = Audio()
    audio.off("service visit")
    audio.step(0, alarm(State.NOT_VERIFIED))
    assert audio.step(REMINDER_NS, alarm(State.NOT_VERIFIED)).pulses == 0


def test_a_new_alarm_breaks_the_silence_of_an_acknowledged_one() -> None:
    audio = Audio()
    audio.step(0, alarm(State.HALT, acknowledged=True))
    assert audio.step(S_NS, alarm(State.RECALIBRATION_REQUESTED, S_NS)).pulses == 10
