"""Provides what others see of a cart from outside: metrics, messages, many carts at once. It reads the status, and asks
the service for nothing else.
"""
