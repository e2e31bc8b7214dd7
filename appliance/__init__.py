"""The instrument: pairs images with poses, estimates the calibration, judges it, and raises the alarm.

At this level only what every room speaks: the values that flow (types) and the bounds of the checks (limits).
"""
