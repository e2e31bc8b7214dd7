"""Deals with the computer that the service runs on: log, journal, disk, memory, sockets, systemd, clocks, load."""
