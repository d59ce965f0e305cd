"""Clients as state machines: bytes in, requests out, responses back. Time is an argument; nothing here does any I/O."""
