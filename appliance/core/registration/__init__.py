"""Determines A, how the picture moves through the tissue: registration, what it needs, and its compiled part."""
