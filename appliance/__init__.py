"""The instrument: pairs images with poses, estimates the calibration, judges it, and raises the alarm."""
