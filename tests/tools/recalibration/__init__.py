"""Tests of tools/recalibration."""
