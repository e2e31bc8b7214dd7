"""Derives the offset of the marker body from pictures of a wire crossing (cross-wire scan). Pure."""
