"""Serves the web page of the cart: its status for all in the room, live recalibration for those who hold a token."""
