"""The daemon: two processes, their threads and rings, the control socket and the log.

At this level only the composition root, its tick, and its stand-in while nothing is configured.
"""
