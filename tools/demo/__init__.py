"""What `probewatch demo` is made of: script, director, load, outcome, report and picture."""
