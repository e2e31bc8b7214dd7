"""Times that more than one module of the core goes by: what was chosen, and what follows from it.

A time that a single module knows stands there. One that follows from another is written as a share of it, so that
a change of the first changes all that is derived from it.
"""

from probewatch.appliance.limits import SWEPT_AGE_S

MOST_APART_NS = 250_000_000
"""Between two poses that a picture's may lie between. More guesses where a hand went meanwhile; less loses pictures to
a slow tracker (4 Hz is the slowest that serves) and to single poses that are missing. Beyond it the marker body was out
of sight: the slip watch begins again, and what was shown counts no more (`appliance.core.line`).
"""
CHANGE_WINDOW_NS = 3_500_000_000
"""The window that finds a change. Longer names it later: a scale is named within 4 s
(tests/appliance/core/quality/test_evidence.py). Shorter shows too little to be sure by three sigmas.
"""
PRESENT_NS = 10_000_000_000
"""The window that measures lively motion, and how old the motion may be by which a parameter is verified now. Longer
windows reach back by up to 30 s, and what they show of a probe at rest is carried. More calls that verified, and lets
what has slowly changed count for longer as what was; less calls carried what a hand shows that goes on. Ten seconds of
lively motion in the plane show what is required (docs/study.md).
"""
SWEEP_WINDOW_NS = round(SWEPT_AGE_S * 1e9)
"""The longest window that measures: what it shows counts for as long. It shows what is required by an elevational sweep
with a hand's tremor, and the whole offset (tests/appliance/core/test_line.py); more costs memory and time.
"""
QUIET_BREATH_S = 4.0
"""Breath of an adult at rest, fifteen a minute. How long breathing takes to be learned goes by it. Less believes what
was learned of too few breaths, more learns them later; twelve to fifteen a minute were tried (docs/study.md)."""
SLOW_BREATH_NS = 6_000_000_000
"""The longest that is waited for: ten a minute. More waits longer for tissue that has gone for good, less takes a slow
breath for that."""
TREMOR_NS = 1_000_000_000
"""Within which the tremor of a hand that rests goes to and fro: what leaves for no longer has not left. More calls a
slow start of motion rest, less ends a rest by tremor."""
COMPARE_NS = 150_000_000
"""Between two comparisons of a picture with the one in which a rest began: each costs a registration, 2 ms. Longer
misses the moments at which a tremor passes the same place."""
HELD_NS = 1_000_000_000
"""For which a doubt must last before it is named: three or four solutions. Less lets one bad window name it, more names
it later; the contact is open before either."""
SELDOM_NS = 1_000_000_000
"""Between two answers to a question that costs as much as a solution, where a second changes little. More answers
later, less costs processor time."""
