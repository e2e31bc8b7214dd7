"""Builds the project and its pages; no wheel carries it."""
