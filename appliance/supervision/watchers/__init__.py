"""Is every device and every process still there, and does it do its work? One concern a file; devices has the order."""
