"""The measuring bench: registration against its peers and its bounds, the self-check, and the cost of the line."""
