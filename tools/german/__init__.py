"""Holds the German of what commands print: tables from the English text or its template, and the functions that look a
text up in them.

The German of what the service states is in appliance/supervision (`languages`, and `de` in the rows of `faults`), that
of the page in tools/page/files/german.js.
"""
