"""What was heard on a line beside a response, or instead of one."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final

from gateway.errors import RequestError
from gateway.modbus.ascii import AsciiFramer
from gateway.modbus.ascii import encode as ascii_encode
from gateway.modbus.chartime import Mode
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.foretell import response_size
from gateway.modbus.frame import Frame
from gateway.modbus.passing import frames_in
from gateway.modbus.pdu import KNOWN_FUNCTIONS, RequestPdu, parse_request

#: The PDU of an exception response.
_EXCEPTION_SIZE: Final = 2


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


def is_response(frame: Frame) -> bool:
    """Whether nobody but its unit can have sent `frame`: a request to it may look like its response."""
    if response_size(frame.pdu) not in {0, len(frame.pdu)}:
        return False
    try:
        return parse_request(frame.pdu).function not in KNOWN_FUNCTIONS
    except RequestError:
        return True


def has_begun(mode: Mode, data: bytes, head: bytes) -> bool:
    """Whether `data` holds the first bytes of a frame."""
    return head.hex().upper().encode() in _plain(data) if mode == "ascii" else head in data


def is_damaged(mode: Mode, data: bytearray, asked: RequestPdu, unit: int | None) -> bool:
    """Whether `data` is, for all that can be seen, a response to `asked` from `unit` with a wrong check sum.

    It has the right beginning and the right size, normal or exception, and neither can be those of a request that was
    damaged. Of an ASCII frame one of the two characters at the end may be damaged.
    """
    pdu_size = (len(data) - 7) / 2 if mode == "ascii" else len(data) - 3
    if pdu_size == asked.response_size != len(asked.data):
        head = asked.response_head
    elif pdu_size == _EXCEPTION_SIZE and asked.response_size is not None:
        head = bytes((asked.function | EXCEPTION_BIT,))
    else:
        return False
    return _begins(mode, data, head, unit)


def _ascii_frames_in(text: bytes) -> tuple[list[Frame], bytes]:
    frames = AsciiFramer().received(text, 0.0)
    for frame in frames:
        text = text.replace(ascii_encode(*frame), b"", 1)
    return frames, text


def _begins(mode: Mode, data: bytearray, head: bytes, unit: int | None) -> bool:
    """Whether a frame of this size from `unit`, None for any, begins with `head`."""
    known = b"" if unit is None else bytes((unit,))
    if mode == "rtu":
        return data.startswith(known + head, 1 - len(known))
    text = _plain(data)
    has_ended = text[-2:-1] == b"\r" or text[-1:] == b"\n"
    digits = (known + head).hex().upper().encode()
    return has_ended and text.startswith(b":") and text.startswith(digits, 3 - 2 * len(known))


def _plain(text: bytes | bytearray) -> bytes:
    """ASCII frames with seven bits a character and upper-case digits."""
    return bytes(character & 0x7F for character in text).upper()
