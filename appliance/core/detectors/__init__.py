"""Contains the detectors, one per file, of what may be wrong with picture, tracker and calibration. All are pure."""
