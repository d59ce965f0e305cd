"""Serial ports and TCP connections: how they are opened, kept open and timed."""
