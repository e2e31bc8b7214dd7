"""Offers clients what the service sees: the process that distributes it, and the code that starts this process."""
