"""A point: the meaning of some coils, some registers, or some bits of a register."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from math import isfinite, isinf
from sys import float_info
from typing import Final, Literal

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.registers.datatypes import BYTE_TYPES, Value, bounds, decode, encode, is_float, is_whole, swapped
from gateway.registers.items import REGISTER, WriteFunction, has_bits
from gateway.registers.numbers import parse_number

#: Whether a point can be written: no, yes, or only written and never read.
Writing = Literal["no", "yes", "only"]

#: No type and scale have room for numbers with more digits before or behind the point: those are not even converted.
_LARGEST_EXPONENT: Final = 400
#: The largest power of ten in a scale register, up or down (SunSpec, type sunssf); beyond it there is no value.
LARGEST_SCALE: Final = 10
#: How bits are written, beside 0 and 1.
_BIT_WORDS: Final[Mapping[str, int]] = {"on": 1, "off": 0, "true": 1, "false": 0}
_WORDS_OF_A_BIT: Final = "write 0 or 1, off or on"
#: How a place without a value is shown.
NO_VALUE: Final = "–"  # noqa: RUF001 - a dash, as in tables


@dataclass(frozen=True, slots=True)
class Point:
    """One value: where it is, how it is encoded and shown. `name` is empty for a plain address.

    `count` is how many items of `area` it takes, registers of `width` bytes each. With `bits`, the first and the last,
    it is only these bits of them; 0 is the lowest. Text has these bits of each register. The value is the encoded
    number times `scale` plus `offset`, in `unit`, and is shown with `decimals`. With `scale_at` it is first multiplied
    by ten to the power of the int16 there. Some numbers have `labels` instead. The encoded numbers `invalid`, which are
    those of the whole register where only bits count, say that there is no value.

    What is written must be from `minimum` to `maximum`, and is written at `write_at` if that is another place. Bits are
    written `in_turn` if a guarded point has bits of their register, too: with a read and a write, not with function 22.
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
    offset: float = 0.0
    invalid: tuple[float, ...] = ()
    bits: tuple[int, int] | None = None
    minimum: float | None = None
    maximum: float | None = None
    write_at: int | None = None
    write_function: WriteFunction = "auto"
    scale_at: int | None = None
    width: int = 2
    in_turn: bool = False

    @property
    def span(self) -> Span:
        """Its own addresses."""
        return Span(self.area, self.address, self.count)

    @property
    def read_span(self) -> Span:
        """The addresses that are read for it: its own, and up to those of its scale."""
        return self.span if self.scale_at is None else self.span.up_to(self.scale_at)

    @property
    def write_span(self) -> Span:
        """The addresses that are written for it: coils or holding registers."""
        area = Area.COILS if has_bits(self.area) else Area.HOLDING
        return Span(area, self.address if self.write_at is None else self.write_at, self.count)

    @property
    def is_guarded(self) -> bool:
        """Whether it is written within limits only, by whomever."""
        return self.write != "no" and (self.minimum is not None or self.maximum is not None)

    @property
    def limits(self) -> str:
        """What may be written, as text: `0 to 1500 rpm`; empty if that is any value."""
        least, greatest = (None if each is None else f"{each:.15g}" for each in (self.minimum, self.maximum))
        unit = f" {self.unit}" if self.unit else ""
        if least is not None and greatest is not None:
            return f"{least} to {greatest}{unit}"
        return (
            f"at least {least}{unit}"
            if least is not None
            else f"at most {greatest}{unit}"
            if greatest is not None
            else ""
        )

    @property
    def rule(self) -> str:
        """What everyone is told who writes another value: `speed must be 0 to 1500 rpm`."""
        return f"{self.name} must be {self.limits}"

    @property
    def bits_shown(self) -> str:
        """Its bits as they stand behind an address: `.3` or `.4-6`; empty if it is no part of a register."""
        if self.bits is None:
            return ""
        first, last = self.bits
        return f".{first}" if first == last else f".{first}-{last}"

    @property
    def is_bit(self) -> bool:
        """Whether it is 0 or 1."""
        return has_bits(self.area) or (self.bits is not None and self.bits[0] == self.bits[1])

    @property
    def least_and_greatest(self) -> tuple[int, int]:
        """The least and the greatest encoded number, of a type of whole numbers."""
        return bounds("bit" if has_bits(self.area) else self.type, self.bits)

    def own(self, items: bytes) -> bytes:
        """Take its own items out of those of its `read_span`."""
        if self.scale_at is None:
            return items
        start = (self.address - self.read_span.start) * self.width
        return items[start : start + self.count * self.width]

    def around(self, own: bytes, items: bytes) -> bytes:
        """Put its own items in the place of those in the items of its `read_span`."""
        start = (self.address - self.read_span.start) * self.width
        return items[:start] + own + items[start + len(own) :]

    def value(self, items: bytes) -> Value | None:
        """Decode the items of its `read_span`: a number, or text.

        None if they say that there is no value, or the number is larger than a float can be.
        """
        if has_bits(self.area):
            return self.labels.get(items[0], items[0])
        carried = self.carried(self.own(items))
        if carried is None or isinstance(carried, str):
            return carried
        if isinstance(carried, int) and carried in self.labels:
            return self.labels[carried]
        exponent = self.exponent(items)
        value = None if exponent is None else self._scaled(carried, exponent)
        return None if value is None or abs(value) > float_info.max else value

    def show(self, value: Value | None) -> str:
        """Write a value of this point as text, without its unit."""
        if value is None:
            return NO_VALUE
        if self.decimals is not None and not isinstance(value, str):
            return f"{Decimal(value):.{self.decimals}f}"  # the numbers of 64 bits are not all floats
        return str(value)

    def items(self, text: str, before: bytes | None = None) -> bytes:
        """Encode a value that a user typed as `text`: a finite number, a label, text. Return its own items.

        Of registers of which only bits are meant the other bits are 0. `before` are the items of the `read_span`, which
        a point with a scale register needs.

        Raises:
            ValueError: the point cannot hold it, it is not within the limits, or there is no scale.
        """
        if self.type == "string":
            return encode(text, self.type, self.swap, self.count * self.width // REGISTER)
        exponent = 0 if before is None else self.exponent(before)
        if exponent is None or (self.scale_at is not None and before is None):
            raise ValueError(f"the device has no scale for {self.name} now")
        number = self._number(text, exponent)
        if has_bits(self.area):
            if not number.is_finite() or number not in (0, 1):
                raise ValueError(f"{text} is not a bit: {_WORDS_OF_A_BIT}")
            return bytes((int(number),))
        self._check_limits(text, number)
        return self.carrying(self._encoded(text, number, exponent))

    def carrying(self, number: float) -> bytes:
        """Make its own items for an encoded number, which its bits can hold.

        Raises:
            ValueError: the type cannot hold it.
        """
        if self.bits is None:
            return encode(number, self.type, self.swap)
        bits = (int(number) << self.bits[0]) & self.mask
        return swapped(bits.to_bytes(self.count * self.width, "big"), self.swap)

    @property
    def mask(self) -> int:
        """The bits of its registers that are its own, as one number."""
        first, last = self.bits or (0, 8 * self.count * self.width - 1)
        return (1 << (last + 1)) - (1 << first)

    @property
    def register_masks(self) -> tuple[int, ...]:
        """The bits of its registers that are its own, of each register as the device has it."""
        own = swapped(self.mask.to_bytes(self.count * self.width, "big"), self.swap)
        return tuple(int.from_bytes(own[at : at + self.width], "big") for at in range(0, len(own), self.width))

    def carried(self, own: bytes) -> Value | None:
        """Find the number that its own items carry; None for one that means no value."""
        if self.type == "string" and self.bits is not None:  # one character in each register
            own = own[1::2] if self.bits[0] == 0 else own[::2]
        if self.bits is None or self.type == "string":
            number = decode(own, self.type, self.swap)
            is_none = isinstance(number, float) and not isfinite(number)
            return None if is_none or number in self.invalid else number
        whole = int.from_bytes(swapped(own, self.swap), "big")
        number = (whole & self.mask) >> self.bits[0]
        if self.type == "int8" and number > bounds("int8")[1]:
            number -= 256
        judged = number if self.type in BYTE_TYPES else whole
        return None if judged in self.invalid else number

    def exponent(self, items: bytes) -> int | None:
        """Find the power of ten that its scale register holds; 0 without one, None if it holds none."""
        if self.scale_at is None:
            return 0
        at = (self.scale_at - self.read_span.start) * self.width
        exponent = int.from_bytes(items[at : at + 2], "big", signed=True)
        return exponent if abs(exponent) <= LARGEST_SCALE else None

    def _number(self, text: str, exponent: int) -> Decimal:
        """Find the number that `text` means; for a label, what its encoded number means."""
        for number, label in self.labels.items():
            if label == text:
                return Decimal(number) * self._factor(exponent) + self._offset
        if self.is_bit and text.lower() in _BIT_WORDS:
            return Decimal(_BIT_WORDS[text.lower()])
        number_ = parse_number(text)
        if number_ is None:
            if self.is_bit and not self.labels:
                raise ValueError(f'"{text}" is not a bit: {_WORDS_OF_A_BIT}')
            known = f"; it has the labels {', '.join(self.labels.values())}" if self.labels else ""
            known = known or ("; decimals stand behind a point" if "," in text else "")
            raise ValueError(f'"{text}" is not a number{known}')
        return number_

    def _check_limits(self, text: str, number: Decimal) -> None:
        if not number.is_finite():
            return
        least, greatest = self.minimum, self.maximum
        if least is not None and number < Decimal(repr(least)):
            raise ValueError(f"{text} is too low: {self.rule}")
        if greatest is not None and number > Decimal(repr(greatest)):
            raise ValueError(f"{text} is too high: {self.rule}")

    def _encoded(self, text: str, number: Decimal, exponent: int) -> int | float:
        """Compute the encoded number for a value."""
        if not number.is_finite():
            if is_float(self.type):
                raise ValueError(f"{text} is not a finite number")
            raise ValueError(f"{text} does not fit into {self.type}")
        if number and abs(number.adjusted()) > _LARGEST_EXPONENT:
            raise ValueError(f"{text} does not fit into {self.type}")
        carried = (number - self._offset) / self._factor(exponent)
        if not is_whole(self.type):
            value = float(carried)
            if isinf(value):
                raise ValueError(f"{text} does not fit into {self.type}")
            return value
        if carried != carried.to_integral_value():
            raise ValueError(self._not_whole(text, exponent))
        least, greatest = self.least_and_greatest
        if not least <= carried <= greatest:
            ends = sorted(self._scaled(bound, exponent) for bound in (least, greatest))
            of, to = (self.show(end) for end in ends)
            raise ValueError(f"{text} does not fit into {self._place}: {of} to {to}")
        return int(carried)

    def _not_whole(self, text: str, exponent: int) -> str:
        if self.scale == 1 and not exponent:
            return f"{text} does not fit into {self._place}: it holds whole numbers only"
        scale = f"{float(self._factor(exponent)):g}"
        if self.offset:
            return f"{text} is not {self.offset:g} plus a multiple of {scale}, the offset and scale of {self.name}"
        return f"{text} is not a multiple of {scale}, the scale of {self.name}"

    @property
    def _place(self) -> str:
        if self.bits is None or self.type in BYTE_TYPES:
            return self.type
        return f"bit{'' if self.is_bit else 's'} {self.bits_shown[1:]}"

    def _scaled(self, carried: float, exponent: int = 0) -> float:
        value = carried
        if self.scale == 1 and not exponent and not self.offset:
            pass
        elif isinstance(carried, int):
            exact = carried * self._factor(exponent) + self._offset
            value = int(exact) if exact == exact.to_integral_value() and self.decimals is None else float(exact)
        else:
            value = carried * float(self._factor(exponent)) + self.offset
        return value if self.decimals is None or isinstance(value, int) else round(value, self.decimals)

    def _factor(self, exponent: int) -> Decimal:
        """Compute the scale as a decimal: 0.1 is one tenth, not the nearest binary fraction."""
        return Decimal(repr(self.scale)).scaleb(exponent)

    @property
    def _offset(self) -> Decimal:
        return Decimal(repr(self.offset))
