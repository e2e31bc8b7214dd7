"""The bench of the hand-over still runs on the service as it is: with few pictures, its figures not judged."""

import pytest

from tests.bench import handover
from tests.bench.receiver import METHODS


@pytest.mark.thorough
def test_every_table_of_the_hand_over_is_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(handover, "_WALKS", 2)
    monkeypatch.setattr(handover, "_DELAYS", 5)
    monkeypatch.setattr(handover, "_IDLE_S", 0.2)
    measured = handover.measure()
    assert len(measured["hops"]) == len(handover.SIZES_PX)
    assert {row["method"] for row in measured["delays"]} == set(METHODS)
    assert "estimator" in {row["process"] for row in measured["idle"]}
