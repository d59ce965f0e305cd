"""The log, and metrics as text.

- log          events to text, JSON or the journal of systemd
- limiter      events that come too often
- fan_out      events for followers over HTTP
- metrics      the exposition of counters
"""
