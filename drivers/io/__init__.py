"""Carries bytes for every protocol (serial ports, TCP, byte logs), and lists what is connected to this host."""
