"""Devices by URL: bytes and clocks in, stamped frames and poses out. Nothing here knows what a calibration is.

At this level only what every room speaks: descriptors of drivers, device_api, registry, samples, rigid motions, errors,
text fit to be shown.
"""
