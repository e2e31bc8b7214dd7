"""The numerical core: samples in, verdicts out. Pure: no clock, thread, file or device."""
