"""A simulated line played through on a table of times: what is written when, what arrives when."""

from typing import NamedTuple

from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.simulator.device import Device
from gateway.simulator.paced_line import PacedLine
from gateway.timing.characters import CharacterFormat

#: One character of 11 bits at 9600 baud.
CHARACTER = 11 / 9600

FORMAT_8E1 = CharacterFormat(8, "E", 1)
FORMAT_7E1 = CharacterFormat(7, "E", 1)


class Arrival(NamedTuple):
    """Characters that became readable, and when."""

    at: float
    data: bytes


def rtu_line(*devices: Device, **settings) -> PacedLine:
    return PacedLine("rtu", FORMAT_8E1, devices, **settings)


def ascii_line(*devices: Device, **settings) -> PacedLine:
    return PacedLine("ascii", FORMAT_7E1, devices, **settings)


def rtu_frame(unit: int, pdu: str) -> bytes:
    return rtu.encode(unit, bytes.fromhex(pdu))


def ascii_frame(unit: int, pdu: str) -> bytes:
    return ascii_framing.encode(unit, bytes.fromhex(pdu))


def write(line: PacedLine, data: bytes, at: float = 0.0, baud: int = 9600) -> bytes:
    """Write at a time; what had become readable by then."""
    readable = line.tick(at)
    line.written(data, at, baud)
    return readable


def arrivals(line: PacedLine) -> list[Arrival]:
    """All that comes from now on, until nothing more happens."""
    found = []
    while (at := line.deadline()) is not None:
        found.append(Arrival(at, line.tick(at)))
    return [arrival for arrival in found if arrival.data]


def ask(line: PacedLine, data: bytes, at: float = 0.0, baud: int = 9600) -> bytes:
    """Write a request, and let time pass until nothing more happens; all that came."""
    before = write(line, data, at, baud)
    return before + b"".join(arrival.data for arrival in arrivals(line))
