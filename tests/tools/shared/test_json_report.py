"""The JSON of a replay is the documented contract."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from probewatch.appliance.core.quality.report import Change, LineReport, report_json
from probewatch.appliance.types import Calibration, Check, Fault, State, Verdict, VerdictKind
from probewatch.drivers.rigid import rotation_from_vector
from tests.support.recordings import REPLAYED_PX


def line_report(**changes):
    covariance = np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 1.0, 2.0, 3.0]) ** 2
    estimate = Calibration(
        rotation_from_vector(np.array([0.1, 0.2, 1.5])),
        (-1, 1),
        np.array([0.08, 0.07]),
        np.array([1.0, 2.0, 3.0]),
        REPLAYED_PX,
        covariance,
        (True,) * 7 + (False,),
    )
    check = Check("scale lateral", Fault.SCALE, 2.0, 0.4, "%", 5.0, VerdictKind.OK)
    report = LineReport(
        frames=10,
        poses=11,
        paired=8,
        unpaired={"no pose after the frame": 2},
        latency=Check("latency", Fault.LATENCY, -20.0, 30.0, "ms", 60.0, VerdictKind.OK),
        estimate=estimate,
        motions=7,
        checks=(check, replace(check, name="scale axial", value=np.nan, verdict=VerdictKind.NOT_VERIFIED)),
        verdict=Verdict(0, VerdictKind.FAULT, (), Fault.POLARITY, "mirrored"),
    )
    return replace(report, **changes)


def test_json_is_the_documented_contract():
    data = report_json(line_report(), [Change(0.5, State.DEVICE_LOST, Fault.VIDEO_LOST, "no picture")])
    assert data == {
        "version": 1,
        "frames": 10,
        "poses": 11,
        "paired": 8,
        "unpaired": {"no pose after the frame": 2},
        "unusable_poses": {},
        "latency": {"value_ms": -20.0, "sigma_ms": 30.0, "verdict": "OK"},
        "tissue": None,
        "calibration": {
            "rotation_vector_rad": pytest.approx([0.1, 0.2, 1.5]),
            "polarity": [-1, 1],
            "scale_mm_per_px": [0.08, 0.07],
            "offset_mm": [1.0, 2.0, 3.0],
            "sigma": {
                "rotation_vector_rad": pytest.approx([0.01, 0.02, 0.03]),
                "scale_mm_per_px": pytest.approx([0.008, 0.014]),
                "offset_mm": [pytest.approx(1.0), pytest.approx(2.0), None],
            },
            "observed": {
                "rotation_vector_rad": [True, True, True],
                "scale_mm_per_px": [True, True],
                "offset_mm": [True, True, False],
            },
            "singular_values": pytest.approx(
                sorted([*(np.deg2rad(1) / s for s in (0.01, 0.02, 0.03)), 0.1, 0.05, 1, 0.5, 1 / 3])[::-1]
            ),
            "motions": 7,
        },
        "second_opinion": None,
        "point": None,
        "checks": [
            {
                "name": "scale lateral",
                "fault": "scale",
                "value": 2.0,
                "sigma": 0.4,
                "unit": "%",
                "limit": 5.0,
                "ratio": 0.4,
                "verdict": "OK",
                "shown_age_s": None,
            },
            {
                "name": "scale axial",
                "fault": "scale",
                "value": None,
                "sigma": 0.4,
                "unit": "%",
                "limit": 5.0,
                "ratio": None,
                "verdict": "NOT_VERIFIED",
                "shown_age_s": None,
            },
        ],
        "verdict": "FAULT",
        "fault": "polarity",
        "proposal": None,
        "limits": {"profile": "coarse", "beside": {}},
        "rivals": [],
        "timeline": [{"t_s": 0.5, "state": "device lost", "reason": "no picture"}],
    }
    json.dumps(data, allow_nan=False)


def test_json_of_an_empty_report_has_every_key():
    empty = line_report(latency=None, estimate=None, checks=(), unpaired={})
    data = report_json(empty, [])
    assert data["latency"] == {"value_ms": None, "sigma_ms": None, "verdict": "NOT_VERIFIED"}
    assert data["calibration"]["rotation_vector_rad"] is None
    assert data["calibration"]["sigma"]["offset_mm"] == [None, None, None]
    assert data["calibration"]["observed"]["scale_mm_per_px"] == [False, False]
    assert set(data) == set(report_json(line_report(), []))


def test_the_document_names_every_key():
    text = (Path(__file__).parents[3] / "docs" / "replay-report.md").read_text()
    data = report_json(line_report(), [Change(0.0, State.MONITORING, None, "")])
    for key in (*data, *data["calibration"]):
        assert f"`{key}" in text or f"`calibration.{key}`" in text, key
