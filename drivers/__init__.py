"""Opens devices by URL: bytes and clocks go in, stamped frames and poses come out. Nothing here knows what a
calibration is.

This level holds only what all subpackages use: descriptors of drivers, device_api, registry, samples, rigid motions,
errors, and text made fit to be shown.
"""
