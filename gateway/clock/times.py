"""Times of day as text, and durations in milliseconds."""

from datetime import UTC, datetime
from typing import Literal


def rfc_3339(time: float, parts: Literal["seconds", "milliseconds"] = "milliseconds") -> str:
    """Write a time in seconds since 1970 as RFC 3339 has it: `2026-05-01T12:00:00.000Z`."""
    return f"{datetime.fromtimestamp(time, UTC).replace(tzinfo=None).isoformat(timespec=parts)}Z"


def milliseconds(seconds: float) -> float:
    """Convert to milliseconds, rounded to a tenth."""
    return round(seconds * 1000, 1)


def optional_ms(seconds: float | None) -> float | None:
    """Convert to milliseconds; None stays None."""
    return None if seconds is None else milliseconds(seconds)
