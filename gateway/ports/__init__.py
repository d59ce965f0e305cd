"""Serial ports and TCP connections: how they are opened, kept open and timed.

- opener, opening    which way a port is opened, by its settings
- serial_port, serial_transport    a serial port: read, written, lost and closed (ADR 15)
- tcp, network    device servers and other servers
- reconnector  a port that is opened again
- error_boundary    a defect in one line ends there
"""
