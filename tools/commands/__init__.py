"""The subcommands of `probewatch`, one file each, named like the command. Code longer than a command is in other
folders.
"""
