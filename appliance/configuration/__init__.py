"""Reads the configuration file: once, whole, and refused by key, value and bound."""
