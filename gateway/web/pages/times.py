"""Times as pages show them, in the time zone of this machine."""

from datetime import datetime


def day_and_time(time: float) -> str:
    """Format a time in seconds since 1970: `2026-05-01 12:00:00`."""
    return f"{datetime.fromtimestamp(time).astimezone():%Y-%m-%d %H:%M:%S}"
