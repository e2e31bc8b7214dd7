"""What the cross-wire tool promises, measured on thousands of pictures and hundreds of scans: `make crosswire`."""
