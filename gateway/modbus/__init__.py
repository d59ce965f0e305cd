"""The Modbus protocol, without I/O; time is an argument, in seconds.

- functions    what a function code may carry, and which functions only read
- pdu, codes, shapes    PDUs taken apart; exceptions
- frame, rtu, ascii, mbap    frames of each transport, and requests cut out of a stream
- scan, scan_rtu, scan_ascii    frames among all bytes on a line, with damaged characters (ADR 3, 13)
- explain      what came in place of a response, in words
"""
