"""Prepares what enters the line: samples fit to compute with, each frame with the pose of its own time. Pure."""
