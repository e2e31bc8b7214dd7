"""What `probewatch study` is made of: sessions, hazards, one run, bounds, the table and its page."""
