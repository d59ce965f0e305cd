"""Certificates for the status."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CertificateStatus:
    """A file that is valid for `days_left`, until the date `until`. The table `used_by` names it by `key`."""

    used_by: str
    source: str
    key: str
    file: str
    subject: str
    until: str
    days_left: float
