"""The Modbus protocol, without I/O; time is an argument, in seconds.

- functions    the table of functions: sizes, checks, which only read
- pdu, codes, shapes    parsed PDUs; exception responses
- frame, rtu, ascii, mbap    frames of each transport, and requests found in a stream
- scan, scan_rtu, scan_ascii    frames found in all bytes on a line, also damaged ones (ADR 3, 13)
- explain      why something is not the response, in words
"""
