"""The self-test before the clinic opens: what was measured, judged item by item, and kept."""
