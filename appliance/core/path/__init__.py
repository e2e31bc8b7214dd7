"""Estimates X, the calibration that explains the path of the picture by the path of the sensor."""
