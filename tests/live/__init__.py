"""Whole carts and devices in real time: `make live`. Whatever is in this folder is left out of the quick suite."""
