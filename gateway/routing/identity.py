"""Who a client is by its certificate."""

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Identity:
    """The subject of a client's certificate, and the role in it; both are empty without a certificate."""

    subject: str = ""
    role: str = ""


#: A client without a certificate.
ANONYMOUS: Final = Identity()
