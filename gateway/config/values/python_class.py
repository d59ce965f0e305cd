"""The name of a class in Python, `module:Name`."""

import re
from typing import Final

from gateway.config.problem import NotText, WrongValue

_EXAMPLE: Final = 'write the module and its class, such as "clock:Clock"'
_IDENTIFIER: Final = r"[^\W\d]\w*"
_CLASS: Final = re.compile(rf"{_IDENTIFIER}(\.{_IDENTIFIER})*:{_IDENTIFIER}")
#: A path of a file, or a module with `.` before its class.
_NEARLY: Final = re.compile(rf"(?P<module>{_IDENTIFIER}(\.{_IDENTIFIER})*?)(\.py)?[:.](?P<name>{_IDENTIFIER})")


def parse_python_class(value: object) -> str:
    """Parse `module:Name`; nothing is imported.

    Raises:
        WrongValue: it is not of this form.
    """
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
