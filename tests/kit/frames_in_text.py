"""Frames and bytes as conversations write them.

`[01 03 02 01 10]` is the frame of unit 1 and this PDU. Before it, `half` and `rest` cut it in two, `to 3` and `from 3`
behind its third byte, `wrong` spoils its check, `lower` writes it in small letters, and `marked` sets the highest bit
of each byte. Bytes outside of brackets are as they are; `55 x 600` is so many.
"""

import re
from collections.abc import Callable, Mapping

_PART = re.compile(
    r"(?:(half|rest|wrong|lower|marked|(?:to|from) \d+) )?(?:\[([0-9A-F ]+)\]|([0-9A-F]{2}))(?: x (\d+))?"
)


def read_bytes(text: str, frame: Callable[[int, str], str]) -> bytes:
    """Read what is on a line; `frame` makes the frame of a unit and a PDU, both in hex."""
    parts = list(_PART.finditer(text))
    assert " ".join(part.group() for part in parts) == text, f"not understood: {text}"
    return b"".join(_part(*part.groups(), frame=frame) for part in parts)


def _part(
    how: str | None, content: str | None, byte: str | None, times: str | None, frame: Callable[[int, str], str]
) -> bytes:
    if content is None:
        return int(times or 1) * bytes.fromhex(byte)
    whole = bytes.fromhex(frame(int(content[:2], 16), content[3:]))
    word, _, at = (how or "as it is").partition(" ")
    return int(times or 1) * _SHAPES[word](whole, int(at) if at.isdigit() else len(whole) // 2)


def _with_wrong_check(whole: bytes, _: int) -> bytes:
    if not whole.endswith(b"\r\n"):
        return whole[:-1] + bytes((whole[-1] ^ 1,))
    digit = b"1" if whole[-3:-2] == b"0" else b"0"
    return whole[:-3] + digit + whole[-2:]


_SHAPES: Mapping[str, Callable[[bytes, int], bytes]] = {
    "as": lambda whole, _: whole,
    "half": lambda whole, at: whole[:at],
    "to": lambda whole, at: whole[:at],
    "rest": lambda whole, at: whole[at:],
    "from": lambda whole, at: whole[at:],
    "wrong": _with_wrong_check,
    "lower": lambda whole, _: whole.lower(),
    "marked": lambda whole, _: bytes(byte | 0x80 for byte in whole),
}
