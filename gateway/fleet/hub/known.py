"""The keys that an earlier config of the hub gave to sites."""

import re
from collections.abc import Mapping
from typing import Final, NamedTuple

_PARTS: Final = re.compile(
    r'^  "(?P<site>[A-Za-z0-9_-]+)": \{|\bnkey: (?P<key>U[A-Z2-7]{55})\b|\bpassword: "(?P<password>[\w-]+)"',
    re.MULTILINE,
)


class Login(NamedTuple):
    """The public key of a site's gateways, and the password of its leaf node, if it has one."""

    key: str
    password: str = ""


def logins_in(text: str) -> Mapping[str, Login]:
    """Find the logins of all sites in the text of a config that `hub_config` has made."""
    found: dict[str, Login] = {}
    site = ""
    for part in _PARTS.finditer(text):
        site = part["site"] or site
        if part["key"]:
            found[site] = Login(part["key"])
        elif part["password"]:
            found[site] = found[site]._replace(password=part["password"])
    return found
