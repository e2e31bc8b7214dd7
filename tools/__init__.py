"""Contains the commands that people type. This level holds only the entry point."""
