"""Bounds the values of a pose that a tracker reports; values beyond them count as damage."""

UNIT_TOLERANCE = 1e-3
"""How far the length of a reported quaternion may be from 1. TX rounds to 1e-4, so undamaged quaternions are within
1e-4. More lets damage pass; less would refuse what rounding does.
"""

FURTHEST_MM = 1e6
"""A kilometre: no tracker sees so far, so a larger number is damage. Damage within this range is left to checksums and
to the second look at leaps. A smaller limit would find more of it, but none of it near the tool.
"""
