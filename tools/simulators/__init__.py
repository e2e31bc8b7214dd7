"""Implements the devices of `probewatch simulate`, one a file, and a whole cart of them with the service."""
