"""What the repository must keep to: every module in its room, tests that notice changes, skips that have a reason."""
