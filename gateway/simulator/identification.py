"""What tells the kind of a simulated device: its identification (function 43/14), and registers."""

from collections.abc import Iterator, Mapping
from struct import pack
from typing import Final

from gateway.errors import IllegalAddress
from gateway.modbus.codes import ONE_OBJECT, Area
from gateway.modbus.functions import READING_IDENTIFICATION
from gateway.modbus.pdu import parse_request
from gateway.profiles.identity import Identity
from gateway.profiles.point import Point
from gateway.profiles.sunspec import END, MARKER, MARKER_SIZE, laid_out

#: The objects of a regular identification, and that each can be asked for alone (A 6.21).
_CONFORMITY: Final = 0x82
#: The last basic object; the others need the code for regular ones.
_LAST_BASIC: Final = 2
_BASIC: Final = 1
#: The longest text that tells the kind, and the longest other one: all of them fit into one response.
_LONGEST: Final = 120
_LONGEST_OTHER: Final = 30


def objects(maker: str, title: str, identity: Identity) -> Mapping[int, bytes]:
    """Make the objects of a device by number: its maker, the text that tells its kind, a revision, its title."""
    texts = {0: maker or "modbus-gateway", 1: identity.fc43, 2: "1.0", 4: title}
    return {
        number: text.encode("utf-8")[: _LONGEST if text == identity.fc43 else _LONGEST_OTHER]
        for number, text in texts.items()
    }


def identification(pdu: bytes, known: Mapping[int, bytes]) -> bytes:
    """Make the response to a request for objects.

    Raises:
        RequestError: the request is malformed, or the device does not have the one object.
    """
    parse_request(pdu)
    code, first = pdu[2], pdu[3]
    if code == ONE_OBJECT:
        if first not in known:
            raise IllegalAddress(f"there is no object {first}")
        asked = {first: known[first]}
    else:
        last = _LAST_BASIC if code == _BASIC else max(known)
        asked = {number: text for number, text in known.items() if (first if first <= last else 0) <= number <= last}
    data = b"".join(bytes((number, len(text))) + text for number, text in asked.items())
    return READING_IDENTIFICATION + bytes((code, _CONFORMITY, 0, 0, len(asked))) + data


def telling_registers(identity: Identity, points: tuple[Point, ...]) -> Iterator[tuple[Area, int, bytes]]:
    """Yield area and address of the registers that tell the kind, with their contents."""
    if identity.register is not None:
        yield identity.register.area, identity.register.address, pack(">H", identity.register.equals)
    if identity.sunspec:
        models = laid_out(identity.sunspec, [point.address for point in points if point.area == Area.HOLDING])
        yield Area.HOLDING, models[0].address - MARKER_SIZE, MARKER
        for model in models:
            yield Area.HOLDING, model.address, pack(">HH", model.model, model.length)
        yield Area.HOLDING, models[-1].end, pack(">HH", END, 0)
