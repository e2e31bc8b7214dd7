"""German is complete: every state, check and reason of the service; what is unknown stays English as a whole."""

import re
from dataclasses import replace

import numpy as np
import pytest

from probewatch.appliance.core.line import Line
from probewatch.appliance.core.path.residual import Lack
from probewatch.appliance.core.quality.gesture import Gesture
from probewatch.appliance.core.quality.judgement import BROKE, Judgement, bounded, judge
from probewatch.appliance.core.quality.proposal import propose
from probewatch.appliance.core.quality.verification import Contradiction, VerificationStatus
from probewatch.appliance.limits import Limits
from probewatch.appliance.storage.alarm_chain import Event
from probewatch.appliance.supervision.alarms import (
    BEHIND,
    CHECK_BUMPED,
    DISTURBED,
    EARLIER,
    EXPIRED_CALIBRATION,
    NO_CALIBRATION,
    NO_LATENCY,
    OUTDATED,
    PARTLY_EARLIER,
    SIGNALS,
)
from probewatch.appliance.supervision.device_health import DeviceHealth, Timeouts
from probewatch.appliance.supervision.device_watchers import watch_devices
from probewatch.appliance.supervision.faults import FAULT_ROWS
from probewatch.appliance.supervision.languages import GERMAN, translated_text
from probewatch.appliance.types import PARAMETERS, Check, Fault, PointError, Rival, State, VerdictKind
from probewatch.drivers.samples import Frame, Stamp
from probewatch.tools.shared.spoken import SPOKEN
from probewatch.tools.shared.status_view import WORDS
from tests.appliance.core.acquisition.test_input_validation import HEALTHY, noisy, verdicts
from tests.appliance.core.test_line import truth

NOT_VERIFIED = VerdictKind.NOT_VERIFIED
LOGGED = (Event.STATE, Event.REQUEST, Event.STOPPED, Event.PROPOSAL, Event.UNDECIDED)
"""Entries that `log` tells in German; what it puts together itself of the others stays English as a whole."""
REQUIRED = Limits().required_age_s.names
STATUS = VerificationStatus(REQUIRED)
SCALED = Check("scale-lateral", Fault.SCALE, 12.0, 3.0, "%", 5.0, NOT_VERIFIED)
LATE = Check("latency", Fault.LATENCY, 90.0, 12.0, "ms", 60.0, NOT_VERIFIED)
UNDECIDED = VerificationStatus(
    REQUIRED,
    contradictions=(Contradiction(SCALED, 0, False), Contradiction(LATE, 0, False)),
    rivals=(Rival(SCALED, 0.0), Rival(LATE, 2.1)),
)
PROPOSALS = (
    propose([Check("latency", Fault.LATENCY, 90.0, 12.0, "ms", 60.0, VerdictKind.FAULT)], truth(HEALTHY), 80.0),
    propose([Check("latency", Fault.LATENCY, -90.0, 12.0, "ms", 60.0, VerdictKind.FAULT)], truth(HEALTHY), 0.0),
    propose([Check("rotation-axial", Fault.ROTATION, 9.0, 0.5, "deg", 3.0, VerdictKind.FAULT)], truth(HEALTHY), 0.0),
    propose([Check("scale-axial", Fault.SCALE, 9.0, 0.5, "%", 5.0, VerdictKind.FAULT)], truth(HEALTHY), 0.0),
)
PROPOSED = {clause for one in PROPOSALS if one for clause in one.text.split("; ") if clause in GERMAN}


def check_names() -> set[str]:
    """Of every check that line and watchers make."""
    _, found = verdicts(noisy((48, 64), np.uint8))
    line = Line(truth(HEALTHY), Limits())
    found += line.step(Frame(Stamp(0, 0), 0, np.zeros((10, 10), np.uint8)))
    found += [line.report().verdict]
    devices = watch_devices(0, DeviceHealth(started_ns=0), Timeouts())
    return {check.name for verdict in found for check in verdict.checks} | {check.name for check in devices}


def test_every_check_is_translated() -> None:
    names = check_names()
    assert names >= {*PARAMETERS, "polarity", "latency", "frozen-tracker", "line of sight"}
    assert names <= {name for row in FAULT_ROWS.values() for name in row.checks}


def test_nothing_is_translated_that_nobody_says() -> None:
    tables = {text for row in SIGNALS.values() for text in (row.text, row.remedy)}
    tables |= {text for row in FAULT_ROWS.values() for text in row.translations()}
    words = {*WORDS.values(), *(state.value for state in State), OUTDATED, BEHIND, DISTURBED, EARLIER, PARTLY_EARLIER}
    words |= {NO_CALIBRATION, EXPIRED_CALIBRATION, CHECK_BUMPED, NO_LATENCY, *SPOKEN.values(), *LOGGED}
    reasons = {text for text in GERMAN if "{" in text and text not in words}
    units = {"deg", "axes"}
    said = {"calibration verified", "verified only in parts", "Probe on tissue", BROKE}
    said |= {gesture.value for gesture in Gesture} | PROPOSED
    assert set(GERMAN) == tables | words | reasons | units | said
    assert len(reasons) == 17


def test_every_word_of_the_status_is_translated_with_the_same_fields() -> None:
    assert {*WORDS.values(), *SPOKEN.values(), *LOGGED} <= set(GERMAN)
    for english, german in GERMAN.items():
        assert sorted(re.findall(r"{[^}]*}", english)) == sorted(re.findall(r"{[^}]*}", german)), english


def checks(**values: tuple[float, float, VerdictKind]) -> tuple[Check, ...]:
    good = {name: Check(name, Fault(name.split("-")[0]), 0.1, 0.1, "%", 5.0, VerdictKind.OK) for name in REQUIRED}
    for name, (value, sigma, verdict) in values.items():
        good[name.replace("_", "-")] = Check(name.replace("_", "-"), Fault.SCALE, value, sigma, "%", 5.0, verdict)
    return tuple(good.values())


@pytest.mark.parametrize(
    "reason",
    [
        judge(0, (), STATUS).reason,
        judge(0, checks(), STATUS).reason,
        judge(0, checks(scale_lateral=(4.6, 0.1, NOT_VERIFIED)), STATUS).reason,
        judge(0, checks(scale_lateral=(-7.3, 0.1, NOT_VERIFIED)), STATUS).reason,
        judge(0, checks(offset_axial=(-7.3, 0.1, NOT_VERIFIED)), STATUS).reason,
        judge(0, checks(scale_axial=(7.3, 0.1, VerdictKind.FAULT)), STATUS).reason,
        judge(0, checks(motion_agreement=(1.7, 0.0, NOT_VERIFIED), polarity=(0.0, 0.0, NOT_VERIFIED)), STATUS).reason,
        judge(
            0, (*checks(), Check("no-picture", Fault.NO_PICTURE, 600.0, 0.0, "ms", 500.0, NOT_VERIFIED)), STATUS
        ).reason,
        judge(0, checks(), UNDECIDED).reason,
        *(one.text for one in PROPOSALS if one),
        bounded(judge(0, checks(), STATUS), None, 2.5).reason,
        bounded(judge(0, checks(), STATUS), PointError((1.0, 3.1), (1.0, 2.0), None, None, 0), 2.5).reason,
        bounded(judge(0, (), STATUS), PointError((1.0, 3.1), (1.0, 2.0), None, None, 0), 2.5).reason,
        judge(0, (), replace(STATUS, lack=Lack("depth_mm", 13.2, 18.0))).reason,
        judge(0, (), replace(STATUS, lack=Lack("tissue_mm2", 296.0, 380.0)), broke=True).reason,
        Judgement(REQUIRED).overall(()).reason,
        Judgement(REQUIRED).overall((), Lack("depth_mm", 13.2, 18.0)).reason,
        Judgement(REQUIRED).overall(checks()).reason,
        replace(judge(0, (), STATUS), reason=OUTDATED).reason,
    ],
)
def test_every_reason_is_told_in_german(reason: str) -> None:
    german = translated_text(reason, "de")
    assert german != reason
    assert not re.search(r"\b(limit|not|its|shown|verified|scale|picture|probe)\b", german), german
    assert re.findall(r"[-+]?\d[\d.]*", german) == re.findall(r"[-+]?\d[\d.]*", reason)


@pytest.mark.parametrize(
    "text",
    [
        "the picture has shape (2, 3, 4), not (height, width): convert colour to grey in the driver",
        "calibration verified; something new",
        "not shown yet: polarity, something-new",
        "as the test wishes",
    ],
)
def test_what_is_unknown_stays_english_as_a_whole(text: str) -> None:
    assert translated_text(text, "de") == text
    assert translated_text(text, "en") == text
