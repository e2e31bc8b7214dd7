"""One detector a file: what of the picture, the tracker and the calibration may be wrong. Pure."""
