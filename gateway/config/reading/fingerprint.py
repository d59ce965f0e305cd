"""Tells whether sites have the same config."""

import hashlib
import re
from typing import Final

from gateway.config.reading.comparing import shown

_DIGITS: Final = 12


def fingerprint(text: str, site: str) -> str:
    """Make 12 hexadecimal digits of a config file; empty for one that a program has made.

    They are the same for two sites if their files differ only in comments, in secrets, and where the file has the name
    of the site: as `site`, as its user, in names of files and leases.
    """
    in_use = shown(text)
    if site:
        in_use = re.sub(rf"(?<![\w-]){re.escape(site)}(?![\w-])", "SITE", in_use)
    return hashlib.sha256(in_use.encode()).hexdigest()[:_DIGITS] if in_use else ""
