"""The Modbus protocol, without I/O; time is an argument, in seconds."""
