"""Names and roles, as text for people and logs, and the name of a class in Python, `module:Name`."""

import re
from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.tls.certificate import LONGEST_ROLE

#: The longest name, in characters.
LONGEST_NAME: Final = 64
_EXAMPLE: Final = 'write the module and its class, such as "clock:Clock"'
_IDENTIFIER: Final = r"[^\W\d]\w*"
_CLASS: Final = re.compile(rf"{_IDENTIFIER}(\.{_IDENTIFIER})*:{_IDENTIFIER}")
#: A path of a file, or a module with `.` before its class.
_NEARLY: Final = re.compile(rf"(?P<module>{_IDENTIFIER}(\.{_IDENTIFIER})*?)(\.py)?[:.](?P<name>{_IDENTIFIER})")


def parse_name(value: object) -> str:
    """Parse a name for people and logs."""
    if not isinstance(value, str):
        raise NotText
    if not value or len(value) > LONGEST_NAME or not value.isprintable() or value != value.strip():
        raise WrongValue(f"must have 1 to {LONGEST_NAME} visible characters, and no space around them")
    if value in (".", ".."):
        raise WrongValue("cannot be a part of the address of a page", "choose another name")
    return value


def parse_role(value: object) -> str:
    """Parse a role in a certificate, or "" for none."""
    if not isinstance(value, str):
        raise NotText
    if len(value) > LONGEST_ROLE or not value.isprintable():
        raise WrongValue(f"must have at most {LONGEST_ROLE} visible characters")
    return value


def parse_python_class(value: object) -> str:
    """Parse `module:Name`; nothing is imported."""
    if not isinstance(value, str):
        raise NotText
    if _CLASS.fullmatch(value) and ".py:" not in value:
        return value
    if "/" in value:
        raise WrongValue("names a module, not a file", _EXAMPLE)
    nearly = _NEARLY.fullmatch(value)
    remedy = _EXAMPLE
    if nearly is not None and nearly["name"] != "py":
        remedy = f'did you mean "{nearly["module"]}:{nearly["name"]}"?'
    raise WrongValue(f'"{value}" is not module:Name', remedy)
