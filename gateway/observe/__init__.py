"""The log, and metrics as text.

- log, printable    events to text or JSON
- journal      events to the journal of systemd
- writer, backlog    the thread that writes, and what waits for it
- limits, limiter      events that come too often, of all kinds and about one subject
- fan_out      events for followers over HTTP
- last_events, event_file    the last events, bounded, and their file
- families, metrics    counters, and their exposition
"""
