"""Huber's cost of innovations: square near zero, straight beyond, so that outliers draw less (docs/method.md, (21))."""

import numpy as np

from probewatch.drivers.rigid import Array

HUBER = 2.0
"""Standard deviations from which an innovation counts less. More lets outliers draw X, less wastes good pictures; heavy
tails break the promised false alarms without it (tests/appliance/core/path/test_solver.py).
"""
HUBER_SHARE = 0.954
"""What the weights leave of the mean square of unit normal innovations: the probability of one within `HUBER`."""


def huber_cost(innovations: Array) -> float:
    """−2 log likelihood of innovations of any shape, those beyond `HUBER` standard deviations counted less."""
    size = np.abs(innovations)
    inner = np.minimum(size, HUBER)
    return float(np.vdot(inner, 2 * size - inner))
