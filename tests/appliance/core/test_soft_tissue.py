"""Line and supervisor over tissue that gives way: a healthy probe is verified, not accused, and no wrong one hides."""

import pytest

from probewatch.tools.study.hazard import Hazard
from probewatch.tools.study.outcome import Outcome, run
from probewatch.tools.study.samples import Conditions, rendered
from probewatch.tools.study.session import Session
from tests.support.kept_pictures import sessions

pytestmark = pytest.mark.thorough


def watched(
    tissue: str, seconds: float, seed: int, hazard: str = "none", motion: str = "gesture", profile: str = "coarse"
) -> Outcome:
    """Outcome of a session with this motion over this tissue."""
    session = Session(motion, tissue, seed, seconds)
    return run(Conditions(session, Hazard.parse(hazard), profile=profile), rendered(session, sessions()))


@pytest.mark.parametrize("tissue", ["half-20+deep", "layer-80+deep"])
def test_a_healthy_probe_is_accused_of_nothing(tissue: str) -> None:
    assert watched(tissue, 8.0, 1).faults == ""


def test_an_organ_that_slides_under_its_wall_accuses_nobody() -> None:
    """It was named a zoom by −9 % after 1.5 s."""
    assert watched("organ-8-lateral", 6.0, 3, motion="in-plane").faults == ""


def test_nor_does_one_that_slides_along_the_beam_of_a_held_probe() -> None:
    """It was named a zoom by +17 % after 14.6 s, although the parts of the picture did not move apart."""
    assert watched("organ-8-axial", 20.0, 3, motion="gesture-hold").faults == ""


def test_a_deep_breath_that_presses_soft_tissue_against_a_resting_face_accuses_nobody() -> None:
    """It was named a zoom by +7 % after 7.7 s."""
    assert watched("half-20+drag-1+deep+breath-12-axial", 30.0, 1, motion="gesture-hold").faults == ""


@pytest.mark.parametrize(("tissue", "seconds", "seed"), [("half-30+deep", 8.0, 3), ("contact-0.6", 12.0, 6)])
def test_a_healthy_probe_is_verified_by_the_gesture(tissue: str, seconds: float, seed: int) -> None:
    """With a part of the face off the skin, the second was named `scale`, +18.7 %, after 4.4 s."""
    outcome = watched(tissue, seconds, seed)
    assert outcome.faults == ""
    assert outcome.closed > 0


@pytest.mark.parametrize("tissue", ["foam-0.1", "foam-0.1+deep"])
@pytest.mark.parametrize("percent", [-10, 11])
def test_tissue_that_follows_as_a_whole_hides_no_wrong_axial_scale(tissue: str, percent: int) -> None:
    """By the share of a turn that ∂u_y/∂x shows alone, the contact closed on −10 % after 2.7 s."""
    assert watched(tissue, 6.0, 1, f"scale-axial={percent}@start").closed == 0


@pytest.mark.parametrize(("profile", "percent"), [("coarse", -8), ("clinical", 5), ("fine", 5)])
def test_an_error_beyond_the_limit_is_hidden_by_no_foam_that_passes_for_rigid(profile: str, percent: int) -> None:
    """It follows by 5 %. Closed for 9 to 27 s; a healthy probe was named `scale`."""
    assert watched("foam-0.05", 14.0, 1, f"scale-axial={percent}@start", profile=profile).closed == 0
    assert watched("foam-0.05", 14.0, 1, profile=profile).faults == ""


@pytest.mark.parametrize("seed", [1, 2])
def test_nor_without_a_gesture(seed: int) -> None:
    """Closed for 3 and 5 s, while a narrow turn had not shown by how much the foam follows."""
    assert watched("foam-0.05", 20.0, seed, "scale-axial=-8@start", motion="in-plane").closed == 0


def test_rigid_tissue_is_verified_whatever_share_its_first_motion_shows() -> None:
    """The first share was .09 ± .05 and was kept, so nothing was verified in 30 s."""
    assert watched("still", 15.0, 5, motion="in-plane").closed > 0


def test_over_foam_tighter_limits_accuse_no_healthy_probe() -> None:
    """It was named `offset`, +8.6 mm of 1.5 mm, after 8.8 s."""
    assert watched("foam-0.1", 10.0, 1, profile="fine").faults == ""


@pytest.mark.parametrize("hazard", ["slide-lateral=8@start", "depth=10@start"])
def test_no_contact_closes_on_a_wrong_probe(hazard: str) -> None:
    assert watched("half-30+deep", 10.0, 1, hazard).closed == 0
