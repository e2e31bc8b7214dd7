"""A: how the picture moves through the tissue. Registration, what it needs, and its compiled part."""
