"""Contains the subcommands of `probewatch`, one file each, named like the command. Code that is more than a command
lies in other folders.
"""
