"""Handles what people and programs may request of the service: socket, requests, status, recalibration."""
