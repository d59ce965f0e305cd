"""The protocol: pure values and functions without I/O; where time matters it is an argument, in seconds."""
