"""Recorded traffic, and why requests failed.

- trace        records as JSON, selected; the operations `trace` and `why`
- reader, sampling    the trace as it grows, with the rights of the reader; a sample of it
- unit_names   the names of units in records
- meanings     what a recorded transaction means, where it covers points
- stories, failures    why requests failed, in sentences; those of one unit
- capture      records as a file for Wireshark
"""
