"""Runs the daemon: two processes with their threads and rings, the control socket and the log.

This level holds only the composition root, its tick, and the stand-in that runs while nothing is configured.
"""
