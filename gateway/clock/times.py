"""Times of day as text."""

from datetime import UTC, datetime
from typing import Literal


def rfc_3339(time: float, parts: Literal["seconds", "milliseconds"] = "milliseconds") -> str:
    """Write a time in seconds since 1970 as RFC 3339 has it: `2026-05-01T12:00:00.000Z`."""
    return f"{datetime.fromtimestamp(time, UTC).replace(tzinfo=None).isoformat(timespec=parts)}Z"
