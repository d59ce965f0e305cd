"""Signs of kinds of devices: reads, and what typical answers are, from the documents named in profiles/*.toml.

They tell apart kinds without a register or an identification for that (`profiles.recognition`), as far as reads can.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from struct import unpack
from typing import Final

from gateway.errors import ExceptionCode
from gateway.modbus.codes import EXCEPTION_BIT, FunctionCode
from gateway.timing.characters import Mode


def _question(function: int, address: int, count: int = 1) -> bytes:
    return bytes((function, *address.to_bytes(2, "big"), *count.to_bytes(2, "big")))


#: The first read of each unit. At address 0 a weigher answers a read of its own address.
FIRST_QUESTION: Final = _question(FunctionCode.READ_HOLDING_REGISTERS, 0)
QUESTION_AT_ZERO: Final = _question(FunctionCode.READ_HOLDING_REGISTERS, 0x10)


@dataclass(frozen=True, slots=True)
class Sign:
    """A read, and a test of whether an answer is typical of a kind of device."""

    question: bytes
    fits: Callable[[bytes, int], bool]


def _refuses(code: int) -> Callable[[bytes, int], bool]:
    return lambda pdu, _unit: pdu[0] & EXCEPTION_BIT > 0 and pdu[1] == code


def _answers(pdu: bytes, _unit: int) -> bool:
    return not pdu[0] & EXCEPTION_BIT


def _is_own_address(pdu: bytes, unit: int) -> bool:
    return _answers(pdu, unit) and pdu[-1] == unit


def _is_rate(pdu: bytes, unit: int) -> bool:
    return _answers(pdu, unit) and unpack(">f", pdu[2:6])[0] in (9600, 14400, 19200)


_COILS: Final = FunctionCode.READ_COILS
_HOLDING: Final = FunctionCode.READ_HOLDING_REGISTERS
_INPUT: Final = FunctionCode.READ_INPUT_REGISTERS

_V80: Final = (
    Sign(_question(_COILS, 0, 1024), _answers),
    Sign(_question(_COILS, 0, 1025), _refuses(ExceptionCode.ILLEGAL_DATA_VALUE)),
)
#: The signs of each kind, from the documents named in profiles/*.toml, as far as reads can tell.
SIGNS: Final[Mapping[Mode, Mapping[str, Sequence[Sign]]]] = {
    "rtu": {
        "weigher": [Sign(QUESTION_AT_ZERO, _is_own_address), Sign(_question(_HOLDING, 0x20, 2), _is_rate)],
        "v80": _V80,
    },
    "ascii": {
        "mint": [
            Sign(FIRST_QUESTION, _refuses(ExceptionCode.ILLEGAL_DATA_ADDRESS)),
            Sign(_question(_HOLDING, 1), _answers),
            Sign(_question(_INPUT, 1), _refuses(ExceptionCode.ILLEGAL_FUNCTION)),
        ],
        "v80": _V80,
    },
}
#: The profile of all other devices.
OTHERS: Final = "generic"
