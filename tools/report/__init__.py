"""Makes pages for people to read: one HTML file each, with plots as inline SVG, which opens without a network."""
