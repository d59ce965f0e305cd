"""What was heard on a line beside a response, or instead of one."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto

from gateway.errors import RequestError
from gateway.modbus import rtu
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.ascii import encode as ascii_encode
from gateway.modbus.chartime import Mode
from gateway.modbus.frame import Frame
from gateway.modbus.passing import frames_in
from gateway.modbus.pdu import KNOWN_FUNCTIONS, RequestPdu, parse_request


class Verdict(Enum):
    """What bytes are that hold no answer."""

    #: Nothing came, or only answers to older requests.
    NOTHING = auto()
    #: What was sent came back, and nothing else.
    ECHO = auto()
    #: Only whole frames came, of other units or other clients: the unit that was asked has said nothing.
    FRAMES = auto()
    #: There is more: it may be an answer that was damaged.
    BROKEN = auto()


@dataclass(frozen=True, slots=True)
class Overheard:
    """What bytes are made of: where the first copy of what was sent begins, or -1; whole frames; the rest."""

    echo_at: int
    frames: list[Frame]
    rest: bytes

    @property
    def verdict(self) -> Verdict:
        """In one word."""
        if self.rest:
            return Verdict.BROKEN
        if self.frames:
            return Verdict.FRAMES
        return Verdict.NOTHING if self.echo_at < 0 else Verdict.ECHO


def overheard(mode: Mode, data: bytes, sent: bytes, late: Iterable[bytes] = ()) -> Overheard:
    """Look at all that was heard since `sent` was sent; `late` are frames in it that answer older requests."""
    if mode == "ascii":
        data = _plain(data)
    for frame in late:
        data = data.replace(frame, b"")
    frames, rest = (_ascii_frames_in if mode == "ascii" else frames_in)(data.replace(sent, b""))
    return Overheard(data.find(sent), frames, rest)


def before(mode: Mode, data: bytes, response: bytes) -> bytes:
    """What of `data` came before `response`: all of it if that is not found."""
    if mode == "ascii":
        data = _plain(data)
    head, found, _ = data.rpartition(response)
    return head if found else data


def is_from(unit: int, mode: Mode, data: bytes) -> bool:
    """Whether `data` holds a frame that nobody but `unit` can have sent: a request to it may look like its response."""
    frames = AsciiFramer().received(data, 0.0) if mode == "ascii" else rtu.responses_from(unit, data)
    return any(frame.unit == unit and not _is_request(frame) for frame in frames)


def has_begun(mode: Mode, data: bytes, head: bytes) -> bool:
    """Whether `data` holds the first bytes of a frame."""
    return head.hex().upper().encode() in _plain(data) if mode == "ascii" else head in data


def is_damaged(mode: Mode, rest: bytes, asked: RequestPdu, unit: int | None) -> bool:
    """Whether `rest` is, for all that can be seen, a response to `asked` from `unit` with a wrong check sum.

    It has the right beginning and the right size, and neither can be those of a request that was damaged.
    """
    if asked.response_size is None or asked.response_size == len(asked.data):
        return False
    rest = _unhexed(rest) if mode == "ascii" else rest[:-2]
    known = b"" if unit is None else bytes((unit,))
    return len(rest) == asked.response_size + 1 and rest.startswith(known + asked.response_head, 1 - len(known))


def _ascii_frames_in(text: bytes) -> tuple[list[Frame], bytes]:
    frames = AsciiFramer().received(text, 0.0)
    for frame in frames:
        text = text.replace(ascii_encode(*frame), b"", 1)
    return frames, text


def _unhexed(text: bytes) -> bytes:
    """The unit identifier and the PDU of an ASCII frame, whatever its check sum; nothing if it is none."""
    try:
        return bytes.fromhex(text.removeprefix(b":").removesuffix(b"\r\n").decode("ascii"))[:-1]
    except ValueError:
        return b""


def _plain(text: bytes) -> bytes:
    """ASCII frames with seven bits a character and upper-case digits."""
    return bytes(character & 0x7F for character in text).upper()


def _is_request(frame: Frame) -> bool:
    try:
        return parse_request(frame.pdu).function in KNOWN_FUNCTIONS
    except RequestError:
        return False
