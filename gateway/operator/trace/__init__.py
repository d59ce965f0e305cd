"""Recorded traffic, and why requests failed.

- trace        the operation `trace`: pages of records as facts
- facts, selection    a record as JSON, and which ones are asked for
- reader, sampling    the trace as it grows, with the rights of the reader; a sample of it
- unit_names   the names of units in records
- meanings     what a recorded transaction means, where it covers points
- why, stories, failures    why requests failed: the operation, in sentences, and those of one unit
- capture      records as a file for Wireshark
"""
