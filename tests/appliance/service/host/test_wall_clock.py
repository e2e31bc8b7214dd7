"""Steps of the wall clock are told from its ordinary ways."""

import pytest

from probewatch.appliance.service.host.wall_clock import WallClock

BEGAN_NS = 1_700_000_000_000_000_000
TICK_NS = 50_000_000


@pytest.mark.parametrize("by_s", [3600.0, -3600.0, 1.5, 25 * 365 * 86400.0])
def test_a_step_is_told_once_with_its_size(by_s: float) -> None:
    clock, step_ns = WallClock(), round(by_s * 1e9)
    found = [clock.look(n * TICK_NS, BEGAN_NS + n * TICK_NS + (step_ns if n >= 10 else 0)) for n in range(20)]
    assert [one for one in found if one is not None] == [pytest.approx(by_s)]
    assert found[10] is not None


def test_slewing_and_late_ticks_are_no_steps() -> None:
    """500 ppm, as fast as a clock is ever slewed, and a tick that comes ten seconds late."""
    clock = WallClock()
    times_ns = [n * TICK_NS + (10_000_000_000 if n > 500 else 0) for n in range(20_000)]
    assert not any(clock.look(t_ns, BEGAN_NS + t_ns + t_ns // 2000) for t_ns in times_ns)
