"""Simulated devices, below the parsers: they speak the real bytes. Only tools and tests may import them.

At this level the devices that need one file, the lines they speak on, and the faults that all of them can show.
"""
