"""Simulated lines: virtual serial ports with devices that behave as in their manuals, timed like a real line.

- line, panel, builtin    a line, and the devices on it
- device, generic, mint, v80, weigher    the kinds of devices
- broken       what `simulate --fault` can break
"""
