"""Defines the times that more than one module of the core uses: what was chosen, and what follows from it.

A time that only one module uses is defined there. One that follows from another is written as a share of it, so that a
change of the first changes all that is derived from it.
"""

from probewatch.appliance.limits import SWEPT_AGE_S

MOST_APART_NS = 250_000_000
"""Largest gap, ns, between the two poses from which a picture's pose is interpolated. More guesses where a hand went
meanwhile; less loses pictures to a slow tracker (4 Hz is the slowest that serves) and to single poses that are missing.
Beyond it the marker body was out of sight: the slip watch begins again, and what was shown no longer counts
(`appliance.core.line`).
"""
CHANGE_WINDOW_NS = 3_500_000_000
"""Length, ns, of the window that finds a change. A longer one names it later: a scale is named within 4 s
(tests/appliance/core/quality/test_evidence.py). A shorter one shows too little to be sure by three sigmas.
"""
PRESENT_NS = 10_000_000_000
"""Length, ns, of the window that measures lively motion, and how old motion may be that verifies a parameter now.
Longer windows reach back by up to 30 s, and what they show of a probe at rest is carried. More calls that verified, and
lets what has slowly changed count for longer as what it was; less calls carried what a hand that keeps moving shows.
Ten seconds of lively motion in the plane show what is required (docs/study.md).
"""
SWEEP_WINDOW_NS = round(SWEPT_AGE_S * 1e9)
"""Length, ns, of the longest window that measures: what it shows counts for as long. An elevational sweep with a hand's
tremor shows in it what is required, and the whole offset (tests/appliance/core/test_line.py); more costs memory and
time.
"""
QUIET_BREATH_S = 4.0
"""Length, s, of a breath of an adult at rest, fifteen a minute. It determines how long breathing takes to be learned.
Less believes what was learned from too few breaths, more learns them later; twelve to fifteen a minute were tried
(docs/study.md).
"""
SLOW_BREATH_NS = 6_000_000_000
"""Length, ns, of the longest breath that is waited for: ten a minute. More waits longer for tissue that has gone for
good, less takes a slow breath for that.
"""
TREMOR_NS = 1_000_000_000
"""Time, ns, within which the tremor of a hand that rests goes to and fro: what leaves for no longer has not left. More
calls a slow start of motion rest, less lets tremor end a rest.
"""
COMPARE_NS = 150_000_000
"""Time, ns, between two comparisons of a picture with the one in which a rest began: each costs a registration, 2 ms. A
longer one misses the moments at which a tremor passes the same place.
"""
HELD_NS = 1_000_000_000
"""Time, ns, for which a doubt must last before it is named: three or four solutions. Less lets one bad window name it,
more names it later; in both cases the contact is open before.
"""
SELDOM_NS = 1_000_000_000
"""Time, ns, between two answers to a question that costs as much as a solution, where a second changes little. More
answers later, less costs processor time.
"""
