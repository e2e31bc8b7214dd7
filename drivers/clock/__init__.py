"""Determines when something was true: clock of the host, clocks and counters of devices, order of stamps."""
