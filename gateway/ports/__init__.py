"""Serial ports and TCP connections: how they are opened, kept open and timed.

- opener, opening, serial_device    opens ports by their settings
- listening    a port that never sends
- serial_port, serial_transport    an open serial port (ADR 15)
- pty_link, pty_port, link_file    virtual ports for programs of this machine
- tcp, network    TCP connections; look-ups of names
- addresses    several addresses of one server
- reconnector  opens a port again after a loss
- error_boundary    keeps a defect in one line from the others
"""
