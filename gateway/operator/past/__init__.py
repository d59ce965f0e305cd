"""What happened.

- events       the last events
- history, uses    sample the counters of lines and units, and keep them in a file
- past, minutes    what lines and units did in the last days, and in the minutes that the trace still has
"""
