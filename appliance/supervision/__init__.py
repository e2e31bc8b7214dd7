"""Turns verdicts into what the room sees: the state machine, its memory, and the alarm table. Pure."""
