"""Northern Digital's Combined API: Polaris, Vega and Aurora over a serial line or TCP."""
