"""One device of `probewatch simulate` a file, and a whole cart of them with the service."""
