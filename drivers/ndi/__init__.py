"""Northern Digital's Combined API: Polaris and Aurora over a serial line."""
