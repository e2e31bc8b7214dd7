"""Alarm outputs, one a file: energised means safe. Beside them what several of them need."""
