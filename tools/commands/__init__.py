"""One subcommand of `probewatch` a file, named as it is typed; what is longer than a command lives elsewhere."""
