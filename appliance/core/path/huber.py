"""Computes Huber's cost of innovations: quadratic near zero, linear beyond, so that outliers bias the estimate less
(docs/method.md, (21)).
"""

import numpy as np

from probewatch.drivers.rigid import Array

HUBER = 2.0
"""Size, in standard deviations, from which an innovation counts less. More lets outliers bias X, less wastes good
pictures; without it, heavy tails break the promise about false alarms (tests/appliance/core/path/test_solver.py).
"""
HUBER_SHARE = 0.954
"""Mean square of unit normal innovations that the weights leave: the probability of one within `HUBER`."""


def huber_cost(innovations: Array) -> float:
    """Returns −2 log likelihood of innovations of any shape; those beyond `HUBER` standard deviations count less."""
    size = np.abs(innovations)
    inner = np.minimum(size, HUBER)
    return float(np.vdot(inner, 2 * size - inner))
