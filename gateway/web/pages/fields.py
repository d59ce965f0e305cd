"""The fields of forms."""

import re
from typing import Final

from gateway.web.front.problems import ProblemError

_WHOLE: Final = re.compile(r"0x[0-9a-f]{1,4}|[0-9]{1,5}", re.IGNORECASE)
_LARGEST: Final = 65535


def whole(text: str, name: str) -> int:
    """Read a number from 0 to 65535: `135` or `0x87`.

    Raises:
        ProblemError: it is no such number.
    """
    text = text.strip()
    number = int(text, 16 if "x" in text.lower() else 10) if _WHOLE.fullmatch(text) else -1
    if not 0 <= number <= _LARGEST:
        raise ProblemError(400, f"{name}: {text} is not a whole number from 0 to {_LARGEST}")
    return number
