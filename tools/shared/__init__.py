"""Holds code shared by several commands: output as text and JSON, the control socket, the samples of a scan."""
