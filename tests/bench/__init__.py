"""The measuring bench: registration against its peers and bounds, the cost of the line, the delay of the contact."""
