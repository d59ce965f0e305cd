"""Clients as state machines: bytes in, requests out, responses back. Time is an argument; there is no I/O."""
