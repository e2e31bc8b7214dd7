"""The daemon: two processes, their threads and rings, the control socket and the log.

At this level only the composition root, which alone opens devices, and its stand-in while nothing is configured.
"""
