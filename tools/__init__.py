"""What people type. At this level only the entry point."""
