"""Files as such, whatever is in them: replaced whole, refused where they are none, parsed within bounds."""
