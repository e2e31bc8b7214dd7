"""Both sides of the process that computes: its start and end, the rings and the link to it, its loop."""
