"""Computes the one world that all twins share: tissue, the hand with the probe, metal. It is pure and seeded."""
