"""Names and roles, as text for people and logs."""

from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.tls.certificate import LONGEST_ROLE

#: The longest name, in characters.
LONGEST_NAME: Final = 64


def parse_name(value: object) -> str:
    """Parse a name for people and logs.

    Raises:
        WrongValue: it would not look like one there.
    """
    if not isinstance(value, str):
        raise NotText
    if not value or len(value) > LONGEST_NAME or not value.isprintable() or value != value.strip():
        raise WrongValue(f"must have 1 to {LONGEST_NAME} visible characters, and no space around them")
    if value in (".", ".."):
        raise WrongValue("cannot be a part of the address of a page", "choose another name")
    return value


def parse_role(value: object) -> str:
    """Parse a role in a certificate, or "" for none.

    Raises:
        WrongValue: no certificate has such a role.
    """
    if not isinstance(value, str):
        raise NotText
    if len(value) > LONGEST_ROLE or not value.isprintable():
        raise WrongValue(f"must have at most {LONGEST_ROLE} visible characters")
    return value
