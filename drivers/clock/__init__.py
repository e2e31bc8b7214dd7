"""When something was true: the clock of the host, clocks and counters of devices, and the order of stamps."""
