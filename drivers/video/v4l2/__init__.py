"""Captures through V4L2: abi (the kernel's structures), node, negotiation, stream, stamps, pixels; source opens a
device.
"""
