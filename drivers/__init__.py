"""Devices by URL: bytes and clocks in, stamped frames and poses out. Nothing here knows what a calibration is."""
