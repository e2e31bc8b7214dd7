"""Holds the sources of poses, one folder per protocol, and at this level the geometry and rules that trackers share."""
