"""The transaction machine of a line: what is asked next, what comes back, and whose it is."""
