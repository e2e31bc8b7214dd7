"""Recorded sessions: their files, and a recording in place of devices."""
