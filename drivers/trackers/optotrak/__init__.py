"""The Optotrak behind NDI's First Principles server: RTC3D over TCP."""
