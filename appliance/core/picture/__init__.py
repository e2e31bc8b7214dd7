"""A: how the picture moves through the tissue. Registration, and what it needs."""
