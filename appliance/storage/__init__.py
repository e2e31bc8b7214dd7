"""What lies on the disk and must survive a power cut: the alarm log and calibrations. No thread, no device."""
