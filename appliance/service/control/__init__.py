"""What a person or a program may ask of the service, and what it answers: socket, requests, status, recalibration."""
