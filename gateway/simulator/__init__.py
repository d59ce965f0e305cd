"""Simulated lines: virtual serial ports with devices that behave as in their manuals, timed like a real line."""
