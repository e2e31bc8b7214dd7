"""Implements `probewatch demo`: script, director, load, outcome, report and picture."""
