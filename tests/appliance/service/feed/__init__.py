"""Tests of appliance/service/feed."""
