"""Pages that people look at: one HTML file each, with plots as inline SVG, which opens without a network."""
