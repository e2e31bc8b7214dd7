"""Holds the threads that keep devices open, so that the tick need not wait for a device."""
