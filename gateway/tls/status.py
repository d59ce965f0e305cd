"""The status of certificates."""

from dataclasses import dataclass
from typing import Final

#: Warnings begin this many days before the end, one a day.
EARLY: Final = 30.0


@dataclass(frozen=True, slots=True)
class CertificateStatus:
    """A file that is valid for `days_left` days, until the date `until`. Table `used_by` names it by `key`."""

    used_by: str
    source: str
    key: str
    file: str
    subject: str
    until: str
    days_left: float
