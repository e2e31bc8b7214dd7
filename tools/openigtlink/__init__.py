"""Sends what the service sees to OpenIGTLink clients such as 3D Slicer and PLUS; beside the service, never in it."""
