"""What the service sees, offered to those who look on: the process that fans it out, and who starts it."""
