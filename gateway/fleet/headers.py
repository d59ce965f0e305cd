"""The headers of a request to another site. Rights depend on none of them."""

from typing import Final

#: By which clock of the owner's until when it may be sent; see `gateway.fleet.clock`.
DEADLINE: Final = "Deadline"
#: Who asks at the sender, with which role, for the audit.
CLIENT: Final = "Client"
ROLE: Final = "Role"
#: How many sites it has passed. A circle of sites ends when there are too many.
HOPS: Final = "Hops"
MOST_HOPS: Final = 4

_LONGEST: Final = 64


def text_of(value: str) -> str:
    """What another site says, so that it may be logged and shown."""
    return "".join(each for each in value[:_LONGEST] if each.isprintable())


def hops_of(value: str) -> int:
    """How many sites a request has passed; too many if the header says nothing that can be understood."""
    return int(value) if value.isascii() and value.isdecimal() and len(value) <= 2 else MOST_HOPS + 1
