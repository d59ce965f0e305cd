"""The headers of a request to another site. Rights never depend on them."""

from typing import Final

#: The time up to which it may be sent, by the clock of each of the owner's gateways; see `gateway.fleet.clock`.
DEADLINE: Final = "Deadline"
#: The sender's client and its role, for the audit.
CLIENT: Final = "Client"
ROLE: Final = "Role"
#: The number of sites passed. A loop of sites ends at MOST_HOPS.
HOPS: Final = "Hops"
MOST_HOPS: Final = 4

_LONGEST: Final = 64


def text_of(value: str, longest: int = _LONGEST) -> str:
    """Make text from another site safe to log and show: printable, and not too long."""
    return "".join(each for each in value[:longest] if each.isprintable())


def hops_of(value: str) -> int:
    """Read the number of sites passed; MOST_HOPS + 1 if the header is malformed."""
    return int(value) if value.isascii() and value.isdecimal() and len(value) <= 2 else MOST_HOPS + 1
