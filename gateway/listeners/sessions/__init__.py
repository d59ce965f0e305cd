"""Clients as state machines: bytes in, requests out, responses back. Time is an argument; there is no I/O.

- session, mbap, over_tcp    clients over TCP: Modbus TCP, and RTU or ASCII
- arrivals     requests in the bytes of RTU or ASCII over TCP
- peer         clients over UDP
- server_line, own_echo, server_counts    the client on a server line
"""
