"""SunSpec: a chain of models in the holding registers ("SunSpec Device Information Model Specification").

"SunS" at one of three addresses is followed by models: number, length, and so many registers. Model FFFF ends them.
"""

from collections.abc import Collection, Generator, Mapping, Sequence
from struct import unpack
from typing import Final, NamedTuple, TypeAlias, TypeVar

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.registers.items import items_read, read_request

MARKER: Final = b"SunS"
#: Where the marker may be, the most usual address first.
BASES: Final = (40000, 50000, 0)
#: The number of the model that ends the chain; its length is 0.
END: Final = 0xFFFF
#: The model that each chain begins with: maker, model, version, serial number.
COMMON: Final = 1
#: The most models that are asked for.
MOST_MODELS: Final = 64
#: The registers of the marker, and of number and length of a model.
MARKER_SIZE: Final = 2
HEADER_SIZE: Final = 2

#: Models with the same registers: of inverters and meters, with integers or with floats, for one phase up to three.
_ALIKE: Final = (range(101, 104), range(111, 114), range(201, 205), range(211, 215))

#: The registers of models, without their header. Those of others differ between devices.
LENGTHS: Final[Mapping[int, int]] = {
    COMMON: 66,
    **dict.fromkeys((101, 102, 103), 50),
    **dict.fromkeys((111, 112, 113), 60),
    120: 26,
    121: 30,
    122: 44,
    123: 24,
    124: 24,
    160: 48,
    **dict.fromkeys((201, 202, 203, 204), 105),
    **dict.fromkeys((211, 212, 213, 214), 124),
}
_USUAL_LENGTH: Final = 50
#: Of model 1 in many devices: without its last register, which only aligns the next model.
_UNALIGNED_COMMON: Final = 65
_LAST_ADDRESS: Final = 0xFFFF

#: Yields read requests, takes the response to each, or None, and returns what was found.
_T = TypeVar("_T")
Questions: TypeAlias = Generator[bytes, bytes | None, _T]


class Model(NamedTuple):
    """A model of a device: the address of its header, and its registers after it."""

    model: int
    address: int
    length: int

    @property
    def end(self) -> int:
        """The address of the next model."""
        return self.address + HEADER_SIZE + self.length


def layout_of(model: int) -> int:
    """Find the first of the models with the same registers as this one."""
    return next((alike[0] for alike in _ALIKE if model in alike), model)


def laid_out(models: Sequence[int], addresses: Collection[int]) -> tuple[Model, ...]:
    """Place models as a device has them whose points are at these holding registers: no header is at one of them."""
    base = next(base for base in sorted(BASES, reverse=True) if base <= min(addresses, default=BASES[0]))
    placed: list[Model] = []
    for number in models:
        at = placed[-1].end if placed else base + MARKER_SIZE
        if placed and placed[-1].model == COMMON and not {at, at + 1}.isdisjoint(addresses):
            placed[-1] = placed[-1]._replace(length=_UNALIGNED_COMMON)
            at -= 1
        placed.append(Model(number, at, LENGTHS.get(number, _USUAL_LENGTH)))
    return tuple(placed)


def walk() -> Questions[tuple[Model, ...]]:
    """Find the models of a device: read the marker, then the header of each model. None without the marker."""
    for base in BASES:
        if (yield from read_registers(base, MARKER_SIZE)) == MARKER:
            return (yield from _walk_models(base + MARKER_SIZE))
    return ()


def _walk_models(at: int) -> Questions[tuple[Model, ...]]:
    models: list[Model] = []
    while len(models) < MOST_MODELS and at + HEADER_SIZE <= _LAST_ADDRESS:
        header = yield from read_registers(at, HEADER_SIZE)
        model = Model(0, at, 0) if header is None else Model(*_placed(header, at))
        if model.model in (0, END) or not model.length or model.end > _LAST_ADDRESS + 1:
            break
        models.append(model)
        at = model.end
    return tuple(models)


def _placed(header: bytes, at: int) -> tuple[int, int, int]:
    number, length = unpack(">HH", header)
    return number, at, length


def read_registers(start: int, count: int, area: Area = Area.HOLDING) -> Questions[bytes | None]:
    """Read registers; None if the device does not answer with them."""
    span = Span(area, start, count)
    request = read_request(span)
    response = yield request
    return items_read(span, response) if response is not None and response[0] == request[0] else None
