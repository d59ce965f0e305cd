"""Numbers of items: what a register holds at first, and the most items of a function."""

import re

from gateway.config.problem import WrongValue

_FUNCTION = re.compile(r"[0-9]{1,9}")


def parse_item(value: object) -> int:
    """Parse what a register or a coil holds at first: 0 to 65535, or true and false.

    Raises:
        WrongValue: it does not fit into a register.
    """
    if isinstance(value, int) and 0 <= value <= 0xFFFF:
        return int(value)
    raise WrongValue("must be 0 to 65535, or for coils true or false")


def parse_limits(value: object) -> dict[int, int]:
    """Parse the most items by function, as in `{ 3 = 99 }`.

    Raises:
        WrongValue: a key is no function, one is there twice, or a value is no quantity.
    """
    if not isinstance(value, dict):
        raise WrongValue("must be a table", "write it as { 3 = 99 }: at most 99 items of function 3")
    limits: dict[int, int] = {}
    for text, most in value.items():
        function = _function_number(text)
        if function in limits:
            raise WrongValue(f"function {function} is there twice")
        limits[function] = _quantity(text, most)
    return limits


def _function_number(text: str) -> int:
    if _FUNCTION.fullmatch(text) and 1 <= int(text) <= 127:
        return int(text)
    raise WrongValue(f'"{text}" is not a valid function number', "functions are numbered 1 to 127")


def _quantity(function: str, most: object) -> int:
    if isinstance(most, int) and not isinstance(most, bool) and most >= 1:
        return most
    raise WrongValue(f"the limit of function {function} must be a whole number from 1")
