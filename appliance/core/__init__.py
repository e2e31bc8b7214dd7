"""The numerical core: samples in, verdicts out. Pure: no clock, thread, file or device.

At this level the line itself, the Motion Analyzer and what all rooms compute with; one room for each further stage.
"""
