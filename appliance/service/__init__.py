"""The daemon: two processes, their threads and rings, the control socket and the log."""
