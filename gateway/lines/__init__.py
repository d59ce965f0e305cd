"""A line: which request is sent next, and which received frame is its response."""
