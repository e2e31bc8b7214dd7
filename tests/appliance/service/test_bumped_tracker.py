"""A tracker that was bumped: whatever alarm stands, the remedy names what the technician does before it can end."""

from pathlib import Path

import numpy as np
import pytest

from probewatch.drivers.device_api import BUMPED
from probewatch.drivers.samples import Pose, PoseStatus, Stamp
from probewatch.drivers.trackers.ndi.status_text import BUMPED as BUMP_BIT
from probewatch.drivers.trackers.ndi.status_text import alert_text
from tests.support.service_parts import ERR_NS
from tests.support.simulated_cart import SimulatedCart

CHECK = {
    "en": "Check the tracker's position sensor; then 'probewatch ack --bump'",
    "de": "Positionssensor des Trackers prüfen; dann 'probewatch ack --bump'",
}


class BumpedCart(SimulatedCart):
    """Once it is bumped, each pose says so, until a person has looked."""

    bumped = False

    def pose(self, t_ns: int, number: int) -> Pose:
        if not self.bumped:
            return super().pose(t_ns, number)
        return Pose(Stamp(t_ns, ERR_NS), number, None, np.nan, PoseStatus.FAULT, alert_text(BUMP_BIT))


def test_the_tracker_says_it_as_the_status_knows_it() -> None:
    assert BUMPED in alert_text(BUMP_BIT)


@pytest.mark.parametrize("language", CHECK)
def test_a_bump_is_told_with_the_command_that_ends_it(tmp_path: Path, language: str) -> None:
    """It said to clear the sensor, and not how."""
    with BumpedCart(tmp_path, more=f'alarm.language = "{language}"\n') as cart:
        cart.monitoring()
        cart.bumped = True
        assert cart.wait_for("device lost")["remedy"] == CHECK[language]
        cart.bumped = False
        cart.monitoring()


@pytest.mark.parametrize("language", CHECK)
def test_the_remedy_of_a_halt_names_it_while_no_motion_can_verify(tmp_path: Path, language: str) -> None:
    """A HALT below which the tracker was bumped said to scan, while every pose was a fault."""
    with BumpedCart(tmp_path, more=f'alarm.language = "{language}"\n') as cart:
        cart.monitoring()
        cart.say("rotation")
        scan = cart.wait_for("halt")["remedy"]
        cart.bumped = True
        told = cart.until(lambda: (now := cart.status())["remedy"] != scan and now)
        assert (told["state"], told["fault"], told["remedy"]) == ("halt", "rotation", CHECK[language])
        cart.bumped = False
        cart.until(lambda: cart.status()["remedy"] == scan)
