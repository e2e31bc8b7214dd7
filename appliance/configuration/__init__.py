"""The configuration file: read once, whole, and refused by key, value and bound."""
