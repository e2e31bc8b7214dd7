"""Runs a live recalibration as one object, which page and terminal drive alike: scan, review, sign, prove."""
