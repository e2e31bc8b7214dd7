"""Defines when a tracker counts as stale, frozen or lost: the constants that hold for every kind of tracker, and the
options that all of them take. There is no behaviour here.
"""

from probewatch.drivers.descriptor import Option

DEADLINE_MS, DEADLINES_MS = 200.0, (20, 5000)
"""Silence after which a tracker is lost, unless the URL sets another, and the range that a URL may set, ms. 200 ms
leaves 50 ms to report a loss within the 250 ms of docs/trackers.md (tests/live/test_tracker_loss.py). More alarms
later; below 20 ms the ordinary delays of a busy host would be losses.
"""

LATENCIES_MS = (0, 500)
"""Range of the constant delay of a tracker that a URL may set, ms. More than half a second is a slip of the decimal
point: no tracker by which a hand is guided is so late.
"""

STALE_PERIODS = 3
"""Periods of the tracker without a new measurement before it is stale. With two, a single lost reply would be an alarm,
as the next one comes two periods after the last; each further period keeps an old pose valid for that much longer (at
60 Hz 17 ms). docs/trackers.md states it.
"""

SLOWEST_PERIOD_NS = 50e6
"""Period that is assumed until two measurements have shown it: that of the slowest tracker, a Vicra at 20 Hz. A longer
one would report later that a tracker was stale from the start; a shorter one would call a Vicra stale.
"""

FROZEN_READINGS = 12
"""Equal poses in a row, under a running counter, that mean a frozen device: 0.2 s at 60 Hz, 0.6 s at 20 Hz. A recorded
Polaris at rest scatters by 0.03 to 0.17 mm along its axes (1 σ, at 2 m), so that several in a row are rarely equal by
chance even at the 0.01 mm resolution of TX. Fewer readings would rely on that alone; more let a frozen pose pass for
longer. Not measured closer to the tracker.
"""

DEADLINE = Option("deadline_ms", "silence after which the tracker is lost", f"{DEADLINE_MS:g}", "ms", DEADLINES_MS)
LATENCY = Option("latency_ms", "known delay from exposure to arrival, taken off every stamp", "0", "ms", LATENCIES_MS)
LOG = Option("log", "where to write a byte log of the connection", form="FILE")
