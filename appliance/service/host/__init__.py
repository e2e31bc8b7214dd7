"""What the service has to do with the computer it runs on: log, journal, disk, memory, systemd, wall clock."""
