"""The web page of the cart: its status for everybody in the room, and the live recalibration for who holds a token."""
