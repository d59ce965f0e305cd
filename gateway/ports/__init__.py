"""Bytes: what a line is connected to, how it is opened, kept open and timed."""
