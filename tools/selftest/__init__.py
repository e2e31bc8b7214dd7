"""Implements the self-test before the clinic opens: what was measured is judged item by item, and kept."""
