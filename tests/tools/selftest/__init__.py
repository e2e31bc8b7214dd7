"""Tests of tools/selftest."""
