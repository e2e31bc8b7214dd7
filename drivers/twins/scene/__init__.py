"""The one world that all twins share: tissue, the hand with the probe, metal. Pure and seeded."""
