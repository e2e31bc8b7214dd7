"""German of what commands say: tables from the English text or its template, and what looks a text up in them."""
