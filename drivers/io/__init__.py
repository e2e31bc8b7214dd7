"""What carries bytes, for every protocol: serial ports, TCP, byte logs, and what is connected to this host."""
