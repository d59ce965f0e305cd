"""Simulated lines: virtual serial ports with devices that behave as their documents say, at the pace of a real line."""
