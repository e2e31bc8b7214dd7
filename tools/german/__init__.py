"""German of what commands say: tables from the English text or its template, and what looks a text up in them.

That of what the service says is in appliance/supervision (`languages`, and `de` in the rows of `faults`), that of the
page in tools/page/files/german.js.
"""
