"""Who made it, who signed it: two people, and days in order."""

from datetime import UTC, date, datetime

import pytest

from probewatch.appliance.crosswire.running import RunningCalibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.german.translation import recognised
from probewatch.tools.shared.digest import file_sha256
from probewatch.tools.shared.sign_off import NOT_MADE, SignOff, remarks_on, whole_record
from tests.support.crossings import SIZE_PX, guided_views


def test_nobody_signs_what_they_made() -> None:
    SignOff("A. Hill", "B. Stone", "physicist").check()
    SignOff("A. Hill").check()
    with pytest.raises(ConfigurationError, match="made it and cannot sign it as well"):
        SignOff("A. Hill", " a.  HILL", "physicist").check()
    with pytest.raises(ConfigurationError, match="a name and a role"):
        SignOff("A. Hill", "B. Stone").check()
    with pytest.raises(ConfigurationError, match="2020-01-01 has passed"):
        SignOff("A. Hill", due=date(2020, 1, 1)).check()
    with pytest.raises(ConfigurationError, match="before it is due"):
        SignOff("A. Hill", due=date(2027, 5, 1), expires=date(2027, 4, 1)).check()


def test_the_record_says_everything_that_was_said_and_measured(tmp_path) -> None:
    data = tmp_path / "scan"
    data.write_bytes(b"scan" * 1_000_000)
    running = RunningCalibration(SIZE_PX)
    for view in guided_views(1, 60):
        running.add(view)
    running.strike(3)
    said = SignOff("A. Hill", "B. Stone", "physicist", "fine", "new cart", "SN 7", "abdomen", date(2027, 5, 1))
    record = whole_record(running.state(), said, str(data), file_sha256(data))
    assert record["views"] == "59 used, 0 rejected, 1 struck out"
    assert len(record["data_sha256"]) == 64
    assert (record["signed_by"], record["signed_role"], record["due"]) == ("B. Stone", "physicist", "2027-05-01")
    assert record["covariance"].count(",") == 35
    assert "expires" not in record
    assert record["software"].startswith("probewatch ")
    with pytest.raises(ValueError, match="nothing was solved"):
        whole_record(RunningCalibration(SIZE_PX).state(), said, "", "")


def test_that_no_check_at_another_point_was_made_is_a_remark() -> None:
    """`calibration show` of such a file said nothing of it."""
    now = datetime(2026, 1, 1, tzinfo=UTC)
    signed = {"made_by": "A. Hill", "signed_by": "B. Stone", "signed_role": "physicist"}
    said = "no check at another point was made: tank is fixed"
    assert list(remarks_on({**signed, "check": f"{NOT_MADE}tank is fixed"}, now)) == [said]
    assert list(remarks_on({**signed, "check": "20 views put it within 0.21 mm"}, now)) == []
    assert recognised(said, "de") != said
