"""Handles files as such, whatever they contain: replaces them whole, refuses what is no file, parses within bounds."""
