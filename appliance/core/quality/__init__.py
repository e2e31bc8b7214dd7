"""Turns what motion has shown into checks, one verdict, and the report on a session (Quality Control). Pure."""
