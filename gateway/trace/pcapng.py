"""Frames as a pcapng file, which Wireshark decodes without any setting.

One interface for each line, of link type 252: an upper PDU with tags in front of it that name the dissector, and ports,
by which the dissector knows requests from responses. What is in brackets is the section of the pcapng specification
(draft-ietf-opsawg-pcapng).
"""

from dataclasses import dataclass
from struct import pack
from typing import Final, Literal

#: Block types (4.1, 4.2, 4.3) and the byte-order magic.
_SECTION: Final = 0x0A0D0D0A
_INTERFACE: Final = 1
_PACKET: Final = 6
_MAGIC: Final = 0x1A2B3C4D

#: Options.
_COMMENT: Final = 1
_APPLICATION: Final = 4
_NAME: Final = 2
_DESCRIPTION: Final = 3
_RESOLUTION: Final = 9
_FLAGS: Final = 2

#: LINKTYPE_WIRESHARK_UPPER_PDU and its tags (Wireshark, epan/exported_pdu.h).
_UPPER_PDU: Final = 252
_DISSECTOR: Final = 12
_PORT_TYPE: Final = 24
_SOURCE_PORT: Final = 25
_DESTINATION_PORT: Final = 26
_TCP: Final = 2

#: How the dissectors are called, and the port of a server that they know. That of RTU is 0 unless somebody sets it.
_DISSECTORS: Final = {"mbrtu": 0, "mbtcp": 502}
_CLIENT_PORT: Final = 49152

#: In the flags of a packet (4.3.1): received or sent, and that its check sum is wrong.
_INBOUND: Final = 1
_OUTBOUND: Final = 2
_BAD_CHECK_SUM: Final = 1 << 24

Dissector = Literal["mbrtu", "mbtcp"]


@dataclass(frozen=True, slots=True)
class Packet:
    """A frame as it stands in the file: seen at `time` (seconds since 1970) on `line`, with its check sum.

    `is_request` and `is_sent` differ on a line where we are the server. `is_damaged`: its check sum is wrong.
    """

    time: float
    line: str
    data: bytes
    comment: str
    is_request: bool
    is_sent: bool
    is_damaged: bool = False
    dissector: Dissector = "mbrtu"


class Writer:
    """Makes the bytes of a file: `head`, then the interfaces and packets as they come."""

    def __init__(self, application: str) -> None:
        self._application = application
        self._interfaces: dict[str, int] = {}

    def head(self) -> bytes:
        """Make the beginning of the file."""
        return _block(_SECTION, pack("<IHHq", _MAGIC, 1, 0, -1) + _options((_APPLICATION, self._application.encode())))

    def interface(self, line: str, description: str) -> bytes:
        """Make the block of a line, before its first packet; nothing if it is known already."""
        if line in self._interfaces:
            return b""
        self._interfaces[line] = len(self._interfaces)
        options = _options((_NAME, line.encode()), (_DESCRIPTION, description.encode()), (_RESOLUTION, b"\6"))
        return _block(_INTERFACE, pack("<HHI", _UPPER_PDU, 0, 0) + options)

    def packet(self, packet: Packet) -> bytes:
        """Make the block of a frame on a line that is known."""
        server, client = _DISSECTORS[packet.dissector], _CLIENT_PORT
        source, destination = (client, server) if packet.is_request else (server, client)
        tags = b"".join(
            (
                _tag(_DISSECTOR, packet.dissector.encode()),
                _tag(_PORT_TYPE, pack(">I", _TCP)),
                _tag(_SOURCE_PORT, pack(">I", source)),
                _tag(_DESTINATION_PORT, pack(">I", destination)),
                _tag(0, b""),
            )
        )
        data = tags + packet.data
        flags = (_OUTBOUND if packet.is_sent else _INBOUND) | _BAD_CHECK_SUM * packet.is_damaged
        microseconds = round(packet.time * 1_000_000)
        fields = (self._interfaces[packet.line], microseconds >> 32, microseconds & 0xFFFFFFFF, len(data), len(data))
        options = _options((_FLAGS, pack("<I", flags)), (_COMMENT, packet.comment.encode()))
        return _block(_PACKET, pack("<5I", *fields) + _padded(data) + options)


def _block(kind: int, body: bytes) -> bytes:
    size = pack("<I", len(body) + 12)
    return pack("<I", kind) + size + body + size


def _options(*options: tuple[int, bytes]) -> bytes:
    """Join options, with the one that ends them."""
    return b"".join(pack("<HH", code, len(value)) + _padded(value) for code, value in options if value) + bytes(4)


def _tag(code: int, value: bytes) -> bytes:
    value = _padded(value)
    return pack(">HH", code, len(value)) + value


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)
