"""What was heard on a line beside the response: an echo of the request, other clients, frames that nobody asked for."""

from dataclasses import dataclass

from gateway.errors import RequestError
from gateway.modbus import rtu
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.chartime import Mode
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import KNOWN_FUNCTIONS, parse_request


@dataclass(frozen=True, slots=True)
class Overheard:
    """`echo_at`: where the very bytes that were sent begin, or -1. `requests`: frames that read as somebody else's.

    `responses`: frames that read as responses and that the framer has passed over: none in ASCII, where it hands over
    all of them. A frame can read as both. `has_noise`: there was more than all that.
    """

    echo_at: int
    requests: tuple[Frame, ...]
    responses: tuple[Frame, ...]
    has_noise: bool


def overheard(mode: Mode, data: bytes, sent: bytes, response: bytes) -> Overheard:
    """What was heard before `response`. `data` is all that was heard since `sent` was sent, the response included."""
    if mode == "ascii":
        data = _plain(data)
    before, found, behind = data.rpartition(response)
    heard = before if found else behind
    rest = heard.replace(sent, b"")
    if mode == "ascii":
        framer = AsciiFramer()
        frames = framer.received(rest, 0.0)
        framer.conclude()
        return Overheard(heard.find(sent), tuple(filter(_is_request, frames)), (), framer.heard_noise)
    requests = requests_in(mode, rest)
    responses = tuple(rtu.responses_in(rest))
    return Overheard(heard.find(sent), requests, responses, bool(rest) and not requests and not responses)


def requests_in(mode: Mode, data: bytes) -> tuple[Frame, ...]:
    """The frames in `data` that read as requests."""
    frames = AsciiFramer().received(data, 0.0) if mode == "ascii" else rtu.requests_in(data)
    return tuple(filter(_is_request, frames))


def is_from(unit: int, mode: Mode, data: bytes) -> bool:
    """Whether `data` holds a frame that nobody but `unit` can have sent: a request to it may look like its response."""
    frames = AsciiFramer().received(data, 0.0) if mode == "ascii" else rtu.responses_from(unit, data)
    return any(frame.unit == unit and not _is_request(frame) for frame in frames)


def has_begun(mode: Mode, data: bytes, head: bytes) -> bool:
    """Whether `data` holds the first bytes of a frame."""
    return head.hex().upper().encode() in _plain(data) if mode == "ascii" else head in data


def _plain(text: bytes) -> bytes:
    """ASCII frames with seven bits a character and upper-case digits."""
    return bytes(character & 0x7F for character in text).upper()


def _is_request(frame: Frame) -> bool:
    try:
        return parse_request(frame.pdu).function in KNOWN_FUNCTIONS
    except RequestError:
        return False
