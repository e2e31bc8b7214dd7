"""The cross-wire scan: from pictures of a wire crossing to the offset of the marker body. Pure."""
