"""Simulates a Polaris, Vega or Aurora below the parser."""
