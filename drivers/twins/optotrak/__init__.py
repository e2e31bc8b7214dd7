"""Simulates an Optotrak and its First Principles server below the parser."""
