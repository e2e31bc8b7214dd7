"""Profiles of the limits: what each says, what is given beside it, and that neither changes anything unseen."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.configuration.noise_file import write_noise
from probewatch.appliance.core.estimator_settings import EstimatorSettings
from probewatch.appliance.core.exact_fields import settings_fields, settings_of
from probewatch.appliance.core.parameters import QUANTITIES, never_shown
from probewatch.appliance.core.quality.check_fields import limits_fields
from probewatch.appliance.limits import PROFILES, Limits, RequiredAges
from probewatch.appliance.types import Fault
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.shared.profile_text import is_usual, profile_text
from tests.appliance.configuration.test_config import GOOD, refusal, written
from tests.appliance.configuration.test_noise_file import NAMED, learned
from tests.appliance.storage.test_calibration_file import calibration

BEFORE = {
    "rotation_deg": 3.0, "scale_percent": 5.0, "offset_mm": 4.0, "latency_ms": 60.0, "frozen_ms": 500.0,
    "marker_fit_mm": 0.75, "marker_shape_mm": 0.75, "witness_mm": 1.0, "witness_deg": 1.0, "field_indicator": 1.5,
    "confidence_sigma": 3.0, "point_mm": None, "point_depth_mm": None, "at_rest_s": 90.0,
}  # fmt: skip
"""The limits of a configuration without any, as they were before there were profiles."""
KEYS = ("rotation_deg", "scale_percent", "latency_ms", "offset_mm", "point_mm")


def limits(folder: Path, section: str) -> Limits:
    return load_config(written(folder, f"{GOOD}[limits]\n{section}\n")).limits


@pytest.mark.parametrize("section", ["", 'profile = "coarse"'])
def test_without_a_profile_and_as_coarse_everything_is_as_before(tmp_path: Path, section: str) -> None:
    told = limits(tmp_path, section)
    assert {name: getattr(told, name) for name in BEFORE} == BEFORE
    assert told == Limits()
    assert told.beside_profile == {}


def test_what_was_given_before_there_were_profiles_counts_as_before(tmp_path: Path) -> None:
    told = limits(tmp_path, "rotation_deg = 2.0\noffset_mm = 12.0\npoint_mm = 6.0")
    assert {name: getattr(told, name) for name in BEFORE} == BEFORE | {
        "rotation_deg": 2.0,
        "offset_mm": 12.0,
        "point_mm": 6.0,
    }


@pytest.mark.parametrize(
    ("profile", "values"), [("clinical", (1.5, 3.0, 30.0, 2.5, 4.0)), ("fine", (1.0, 2.0, 20.0, 1.5, 2.5))]
)
def test_a_profile_says_five_limits_and_nothing_else(tmp_path: Path, profile: str, values: tuple[float, ...]) -> None:
    told = limits(tmp_path, f'profile = "{profile}"')
    assert tuple(getattr(told, key) for key in KEYS) == values
    assert {**told.model_dump(exclude={*KEYS, "profile"})} == Limits().model_dump(exclude={*KEYS, "profile"})
    assert told.beside_profile == {}


def test_each_profile_is_tighter_in_everything_than_the_one_before() -> None:
    names = list(PROFILES)
    for looser, tighter in pairwise(names):
        before, after = Limits(profile=looser), Limits(profile=tighter)
        for key in KEYS:
            assert getattr(before, key) is None or getattr(after, key) < getattr(before, key)


@pytest.mark.parametrize(
    ("section", "beside", "said"),
    [
        ('profile = "fine"\noffset_mm = 10.0', {"offset_mm": 10.0}, "limits: fine, but for offset_mm 10"),
        ('profile = "clinical"\noffset_mm = 2.5', {}, "limits: clinical"),
        ('profile = "fine"\nconfidence_sigma = 1.0', {"confidence_sigma": 1.0}, "but for confidence_sigma 1"),
        ('profile = "fine"\nat_rest_s = 120.0', {"at_rest_s": 120.0}, "but for at_rest_s 120"),
        ("point_mm = 3.0", {"point_mm": 3.0}, "limits: coarse, but for point_mm 3"),
        ("frozen_ms = 900", {}, "limits: coarse"),
        ("point_depth_mm = 30", {}, "limits: coarse"),
    ],
)
def test_what_is_given_beside_a_profile_counts_and_is_told(
    tmp_path: Path, section: str, beside: dict[str, float], said: str
) -> None:
    told = limits(tmp_path, section)
    assert told.beside_profile == beside
    fields = json.loads(json.dumps(limits_fields(told)))
    assert fields["beside"] == beside
    assert profile_text(fields).endswith(said)
    assert is_usual(fields) == (fields == {"profile": "coarse", "beside": {}})


def test_a_smaller_region_and_parameters_left_out_are_told(tmp_path: Path) -> None:
    more = '[limits]\nprofile = "clinical"\n[limits.region]\nbottom = 0.1\n[limits.required_age_s]\noffset-axial = 0\n'
    fields = json.loads(json.dumps(limits_fields(load_config(written(tmp_path, GOOD + more)).limits)))
    assert profile_text(fields) == "limits: clinical, but for region, required_age_s"
    assert fields["beside"]["required_age_s"]["offset-axial"] == 0
    assert profile_text(fields, "de") == "Grenzen: clinical, außer region, required_age_s"


def test_an_older_service_names_none() -> None:
    assert (profile_text(None), is_usual(None)) == ("", True)


@pytest.mark.parametrize("value", ['"finer"', "1", '["fine"]', "{}"])
def test_another_profile_is_refused_by_name(tmp_path: Path, value: str) -> None:
    message = refusal(tmp_path, f"{GOOD}[limits]\nprofile = {value}\n")
    assert "[limits] profile" in message
    assert "'coarse', 'clinical' or 'fine'" in message


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("given", [{}, {"offset_mm": 9.0}, {"point_mm": None}, {"point_mm": 7.5, "latency_ms": 5.0}])
def test_a_feed_and_a_black_box_bring_the_same_limits_back(profile: str, given: dict[str, Any]) -> None:
    told = Limits.model_validate({"profile": profile, **given})
    settings = EstimatorSettings(3, calibration(), told, 500_000_000)
    assert settings_of(json.loads(json.dumps(settings_fields(settings)))).limits == told


def test_an_order_from_before_there_were_profiles_is_read_as_it_was() -> None:
    fields = settings_fields(EstimatorSettings(1, calibration(), Limits(rotation_deg=2.0), 1))
    del fields["limits"]["profile"]
    assert settings_of(fields).limits == Limits(rotation_deg=2.0)


def test_noise_that_was_learned_under_another_profile_is_refused(tmp_path: Path) -> None:
    write_noise(tmp_path / "noise.toml", learned())
    with pytest.raises(ConfigurationError, match=r"was learned under other \[limits\], rotation_deg = 3"):
        load_config(written(tmp_path, f'{NAMED}[limits]\nprofile = "clinical"\n'))


def test_what_no_motion_can_show_within_its_limit() -> None:
    for tissue in (True, False):
        assert never_shown(Limits(), tissue) == never_shown(Limits(profile="clinical"), tissue) == ()
    assert never_shown(Limits(profile="fine"), rigid=True) == ()
    assert never_shown(Limits(profile="fine"), rigid=False) == (Fault.OFFSET,)
    assert never_shown(Limits(profile="fine", confidence_sigma=2.5), rigid=False) == ()
    assert never_shown(Limits(offset_mm=0.6), rigid=True) == (Fault.OFFSET,)
    left_out = {f"offset-{axis}": 0.0 for axis in ("lateral", "axial", "elevational")}
    assert never_shown(Limits(profile="fine", required_age_s=RequiredAges.model_validate(left_out)), rigid=False) == ()
    tight = {one.limit_key: 5 * one.left_out_rigid for one in QUANTITIES.values()}
    assert never_shown(Limits.model_validate({**tight, "confidence_sigma": 5.0}), rigid=True) == tuple(QUANTITIES)
