"""Implements the instrument: pairs images with poses, estimates the calibration, judges it, and raises the alarm.

This level holds what every folder uses, the values that flow (types) and the bounds of the checks (limits), and the
interface for other programs (api).
"""
