"""Numbers as people type them."""

from decimal import Decimal, InvalidOperation


def parse_number(text: str) -> Decimal | None:
    """Parse a number: 12, -3.5, 1e3, 0x1F, 0b101; None if it is not one."""
    digits = text.strip().lower()
    if "_" in digits or not digits.isascii():  # Python's own reader takes 1_000 and digits of every script
        return None
    for prefix, base in (("0x", 16), ("0b", 2)):
        if digits.lstrip("+-").startswith(prefix):
            try:
                return Decimal(int(digits, base))
            except ValueError:
                return None
    try:
        return Decimal(digits)
    except InvalidOperation:
        return None
