"""Stores on the disk what must survive a power cut: the alarm log, calibrations, recordings. No thread, no device."""
