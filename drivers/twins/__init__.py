"""Simulates devices below the parsers, so that they speak the real bytes. Only tools and tests may import them.

This level holds the devices that need one file, the lines they speak on, and the faults that all of them can show.
"""
