"""The package for arm64 under qemu-user: the quick tests, and whether its figures are those of this machine."""
