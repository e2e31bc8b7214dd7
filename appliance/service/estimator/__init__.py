"""Holds both sides of the estimator process: its start and end, the rings and the link to it, and its loop."""
