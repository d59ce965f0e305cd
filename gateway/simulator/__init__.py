"""Simulated lines: virtual serial ports with devices that behave as in their manuals, timed like a real line.

- line, panel, builtin    a line, and the devices on it
- server       devices behind a Modbus TCP server
- device, generic, mint, v80, weigher    the kinds of devices
- profiled, described    a device of any other kind, by its profile
- plausible, point_values, identification    the values of its points, and what tells its kind
- broken       what `simulate --fault` can break
"""
