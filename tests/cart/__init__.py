"""The cart as a whole machine: `make test-cart`.

image builds the package, a root file system with it, and a disk; container boots the file system under systemd-nspawn
at full speed; guest boots the disk under QEMU, with the kernel's vivid as scanner input, gpio-sim as relay line, serial
ports to the project's simulated tracker, and a hardware watchdog. inside holds what is put into the machine besides.
"""
