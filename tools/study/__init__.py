"""Implements `probewatch study`: sessions, hazards, one run, bounds, the table and its page."""
