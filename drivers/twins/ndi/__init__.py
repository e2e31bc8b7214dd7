"""A Polaris, Vega or Aurora below the parser."""
