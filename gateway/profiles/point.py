"""A point, the meaning of some coils or registers of a device, and what was read or written there."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from math import isfinite, isinf
from typing import Any, Final, Literal

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.registers.datatypes import Value, bounds, decode, encode, is_float, is_whole
from gateway.registers.items import has_bits, reference

#: Whether a point can be written: no, yes, or only written and never read.
Writing = Literal["no", "yes", "only"]

#: No type and scale have room for numbers with more digits before or behind the point: those are not even converted.
_LARGEST_EXPONENT: Final = 400
#: How bits are written, beside 0 and 1.
_BIT_WORDS: Final[Mapping[str, int]] = {"on": 1, "off": 0, "true": 1, "false": 0}


@dataclass(frozen=True, slots=True)
class Point:
    """One value: where it is, how it is encoded and shown. `name` is empty for a plain address.

    `count` is how many items of `area` it takes. The value is the encoded number times `scale`, in `unit`, and is shown
    with `decimals`. Some numbers have `labels` instead.
    """

    name: str
    area: Area
    address: int
    type: str = "uint16"
    swap: str = "none"
    count: int = 1
    scale: float = 1.0
    decimals: int | None = None
    unit: str = ""
    labels: Mapping[int, str] = field(default_factory=dict)
    write: Writing = "no"

    @property
    def span(self) -> Span:
        """Its addresses."""
        return Span(self.area, self.address, self.count)

    def value(self, items: bytes) -> Value:
        """Decode its items: a number, or text."""
        if has_bits(self.area):
            return self.labels.get(items[0], items[0])
        carried = decode(items, self.type, self.swap)
        if isinstance(carried, str):
            return carried
        if isinstance(carried, int) and carried in self.labels:
            return self.labels[carried]
        return self._scaled(carried)

    def show(self, value: Value) -> str:
        """Write a value of this point as text, without its unit."""
        if self.decimals is not None and not isinstance(value, str):
            return f"{value:.{self.decimals}f}"
        return str(value)

    def items(self, text: str) -> bytes:
        """Encode a value that a user typed as `text`: a finite number, a label, text.

        Raises:
            ValueError: the point cannot hold it.
        """
        if self.type == "string":
            return encode(text, self.type, self.swap, self.count)
        number = self._number(text)
        if has_bits(self.area):
            if not number.is_finite() or number not in (0, 1):
                raise ValueError(f"{text} is not a bit: write 0 or 1, off or on")
            return bytes((int(number),))
        return encode(self._carried(text, number), self.type, self.swap)

    def _number(self, text: str) -> Decimal:
        """Find the number that `text` means; for a label, the encoded number."""
        for number, label in self.labels.items():
            if label == text:
                return Decimal(number) * self._factor
        if has_bits(self.area) and text.lower() in _BIT_WORDS:
            return Decimal(_BIT_WORDS[text.lower()])
        number_ = parse_number(text)
        if number_ is None:
            known = f"; it has the labels {', '.join(self.labels.values())}" if self.labels else ""
            raise ValueError(f'"{text}" is not a number{known}')
        return number_

    def _carried(self, text: str, number: Decimal) -> int | float:
        """Compute the encoded number for a value."""
        if not number.is_finite():
            if is_float(self.type):
                raise ValueError(f"{text} is not a finite number")
            raise ValueError(f"{text} does not fit into {self.type}")
        if number and abs(number.adjusted()) > _LARGEST_EXPONENT:
            raise ValueError(f"{text} does not fit into {self.type}")
        carried = number / self._factor
        if not is_whole(self.type):
            value = float(carried)
            if isinf(value):
                raise ValueError(f"{text} does not fit into {self.type}")
            return value
        if carried != carried.to_integral_value():
            if self.scale != 1:
                raise ValueError(f"{text} is not a multiple of {self.scale:g}, the scale of {self.name}")
            raise ValueError(f"{text} does not fit into {self.type}: it holds whole numbers only")
        least, greatest = bounds(self.type)
        if not least <= carried <= greatest:
            of, to = (self.show(self._scaled(bound)) for bound in sorted((least, greatest), key=self._scaled))
            raise ValueError(f"{text} does not fit into {self.type}: {of} to {to}")
        return int(carried)

    def _scaled(self, carried: float) -> float:
        value = carried
        if self.scale != 1 and isinstance(carried, int):
            exact = carried * self._factor
            value = int(exact) if exact == exact.to_integral_value() and self.decimals is None else float(exact)
        elif self.scale != 1:
            value = carried * self.scale
        return value if self.decimals is None or isinstance(value, int) else round(value, self.decimals)

    @property
    def _factor(self) -> Decimal:
        """The scale as a decimal: 0.1 is one tenth, not the nearest binary fraction."""
        return Decimal(repr(self.scale))


@dataclass(frozen=True, slots=True)
class Reading:
    """A point and the items that were read or written there; `before` are those that were there before a write."""

    point: Point
    items: bytes
    before: bytes | None = None

    @property
    def value(self) -> Value:
        """What the items mean."""
        return self.point.value(self.items)

    @property
    def registers(self) -> list[int]:
        """The registers as numbers; coils and inputs have none."""
        if has_bits(self.point.area):
            return []
        return [int.from_bytes(self.items[at : at + 2], "big") for at in range(0, len(self.items), 2)]

    def as_json(self, *, with_area: bool) -> dict[str, Any]:
        """Make the reading for programs; points of several areas need `with_area`."""
        point = self.point
        named = {"point": point.name} if point.name else {}
        unit = {"unit": point.unit} if point.unit else {}
        before = {} if self.before is None else {"old": finite(point.value(self.before))}
        return {
            **named,
            **({"area": point.area} if with_area else {}),
            "address": point.address,
            "reference": reference(point.area, point.address),
            "value": finite(self.value),
            **before,
            **unit,
            "registers": self.registers,
        }


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


def finite(value: Value) -> Value | None:
    """Turn a value into one of JSON, which has no infinity and no not-a-number: those become None."""
    return None if isinstance(value, float) and not isfinite(value) else value
