"""What several commands share: text and JSON for people and machines, the socket, samples of a scan."""
