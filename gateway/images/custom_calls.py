"""The calls of a unit made in Python that a request is: `read` and `write`, one or two of them."""

from collections.abc import Generator
from struct import Struct, unpack
from typing import Final, NamedTuple

from gateway.modbus.codes import FunctionCode
from gateway.modbus.pdu import RequestPdu, Span
from gateway.profiles.profile import Profile
from gateway.registers.items import has_bits, pack_bits, unpack_bits
from gateway.registers.masks import masked, write_after

_WORD: Final = Struct(">H")


class Call(NamedTuple):
    """A call of `read`, or of `write` if there are `values`; a bit is 0 or 1."""

    span: Span
    values: tuple[int, ...] | None = None


#: The calls of a request. Each gives the items that were read, two bytes for a register and one for a bit, or nothing;
#: in the end the response PDU is returned.
Steps = Generator[Call, bytes, bytes]


def steps_of(asked: RequestPdu, profile: Profile, in_one_turn: int = 0) -> Steps:
    """Yield the calls of a checked request: functions 22 and 23 have two.

    With `in_one_turn`, which is as in `Request`, the profile must also accept what bits make of their register.

    Raises:
        RequestError: it does not.
    """
    write, read = asked.write, asked.read
    if asked.function == FunctionCode.MASK_WRITE_REGISTER and write is not None:
        (before,) = _WORD.unpack((yield Call(write)))
        if in_one_turn and not profile.masks(asked.data):
            profile.check(write_after(asked.data, before, in_one_turn))
        yield Call(write, (masked(asked.data, before),))
    elif write is not None:
        yield Call(write, _values(asked, write))
    if read is None:
        return asked.response_head
    items = yield Call(read)
    return asked.response_head + (pack_bits(items) if has_bits(read.area) else items)


def _values(asked: RequestPdu, span: Span) -> tuple[int, ...]:
    """Return what a request writes to the items of `span`."""
    if asked.function == FunctionCode.WRITE_SINGLE_COIL:
        return (1,) if asked.data[3] else (0,)
    if has_bits(span.area):
        return tuple(unpack_bits(asked.values, span.count))
    return unpack(f">{span.count}H", asked.values)
