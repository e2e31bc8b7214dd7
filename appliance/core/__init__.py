"""Turns samples into verdicts: the numerical core. Pure: no clock, thread, file or device.

This level holds the line itself, the Motion Analyzer and what all stages compute with; each further stage has a folder.
"""
