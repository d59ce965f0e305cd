"""The log, and metrics as text.

- log          events to text, JSON or the journal of systemd
- limiter      events that come too often
- fan_out      events for followers over HTTP
- families, metrics    counters, and their exposition
"""
