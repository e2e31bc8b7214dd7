"""What a pose that a tracker reports may be, before it counts as damage."""

UNIT_TOLERANCE = 1e-3
"""How far the length of a reported quaternion may be from 1. TX rounds to 1e-4, so whole ones are within 1e-4; more
lets damage pass, less would refuse what rounding does."""

FURTHEST_MM = 1e6
"""A kilometre: no tracker sees so far, so such a number is damage. Damage within it is left to check sums and to
the second look at leaps; less room would find more of it, and none of it near the tool."""
