"""What carries bytes, whoever speaks: serial ports, TCP, byte logs, and what is connected to this host."""
