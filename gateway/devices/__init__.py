"""The targets on a line: its devices, broadcasts, and devices that deviate from the protocol."""
