"""The demo's lines, config, and requests with the responses that the device manuals print."""

from collections.abc import Sequence
from dataclasses import dataclass
from struct import unpack
from typing import Final

from gateway.registers.items import unpack_bits


@dataclass(frozen=True, slots=True)
class DemoLine:
    """A simulated line: the arguments for `simulate`, and its config without the port."""

    name: str
    simulate: tuple[str, ...]
    config: str


@dataclass(frozen=True, slots=True)
class DemoRequest:
    """A request to `unit` and its expected response, both as PDUs in hexadecimal.

    `printed` are the frames on the line, if a manual prints them; `shows` says how to read the response.
    """

    unit: int
    about: str
    request: str
    answer: str
    shows: str = ""
    printed: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class Chapter:
    """Some questions under one heading."""

    heading: str
    questions: tuple[DemoRequest, ...]


SITE: Final = "demo-plant"

LINES: Final = (
    DemoLine(
        "silo",
        ("weigher", "--unit", "1", "--weight", "4999.66"),
        'baud = 9600\ndevices = [{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }]',
    ),
    DemoLine(
        "dock",
        ("weigher", "--unit", "1"),
        'baud = 9600\ndevices = [{ unit = 1, as = 42, name = "dock-1", profile = "weigher" }]',
    ),
    DemoLine(
        "yard",
        ("weigher", "--unit", "1"),
        'baud = 9600\ndevices = [{ unit = 0, as = 50, name = "yard-1", profile = "weigher" }]',
    ),
    DemoLine(
        "plc",
        ("v80", "--unit", "6,17"),
        "baud = 19200\n"
        'devices = [{ unit = 6, as = 46, name = "press", profile = "v80" },\n'
        '           { unit = 17, as = 57, name = "oven", profile = "v80" }]',
    ),
    DemoLine(
        "motion",
        ("mint", "--unit", "2,3", "--silent-unit", "3"),
        'mode = "ascii"\nbaud = 19200\nformat = "7E1"\nlatency = "100 ms"\n'
        'devices = [{ unit = 2, as = 52, name = "axis-1", profile = "mint" },\n'
        '           { unit = 3, as = 53, name = "axis-2", profile = "mint" }]',
    ),
)

#: The line of the HMI: here the gateway is the server.
PANEL: Final = "panel"
PANEL_LINE: Final = (
    'mode = "ascii"\nbaud = 19200\nformat = "7E1"\nrole = "server"\nserves = [41, 46]\nanswer_within = "5 s"\n'
)

IMAGE: Final = '[[image]]\nunit = 200\nname = "shift-data"\nholding = 100\n'

#: Registers of all devices in one block. Only axis-2 is missing: the script shows how long it is silent.
_MAPPED: Final = (
    '{ at = 0, device = "silo-1", point = "weight", every = "1 s" }',
    '{ at = 2, device = "press", holding = "107-109", every = "1 s" }',
    '{ at = 5, device = "oven", holding = "107-109", every = "1 s" }',
    '{ at = 8, device = "axis-1", holding = "29-30", every = "1 s" }',
    '{ at = 10, device = "dock-1", point = "weight", every = "1 s" }',
    '{ at = 12, device = "yard-1", point = "weight", every = "1 s" }',
    '{ at = 14, device = "shift-data", holding = 0, every = "1 s" }',
    '{ at = 15, fresh = ["silo-1", "press", "oven", "axis-1", "dock-1", "yard-1", "shift-data"] }',
)


def virtual_unit(more: Sequence[str] = ()) -> str:
    """Make the config of the unit that gathers the devices of all lines; `more` are rows of other lines."""
    head = '[[image]]\nunit = 240\nname = "plant"\nstale = "5 s"\nwhen_stale = 0x7FC0\n'
    return "".join([head, "map = [\n", *(f"  {row},\n" for row in (*_MAPPED, *more)), "]\n"])


def _quote(unit: int, about: str, request: str, response: str, shows: str = "") -> DemoRequest:
    """Make a question of the frames in a manual: unit identifier, PDU, CRC."""
    return DemoRequest(unit, about, request[3:-6], response[3:-6], shows, (request, response))


FIRST_QUESTION: Final = _quote(
    41, "the weight on silo-1", "01 03 00 00 00 02 C4 0B", "01 03 04 45 9C 3D 51 FE 7D", "float32"
)

CHAPTERS: Final = (
    Chapter(
        "Weighing transducers, RTU 9600 8E1: all frames in the manual",
        (
            _quote(41, "its baud rate", "01 03 00 20 00 02 C5 C1", "01 03 04 46 16 00 00 0E BF", "float32"),
            _quote(50, "its address, read at unit 0", "00 03 00 10 00 01 84 1E", "01 03 02 00 01 79 84", "uint16"),
            _quote(42, "take zero", "01 10 1A 00 00 01 02 00 BB 5D E2", "01 10 1A 00 00 01 06 D1"),
            _quote(42, "change to 19200", "01 10 02 00 00 02 04 46 96 00 00 1F AB", "01 10 02 00 00 02 40 70"),
            _quote(42, "back to 9600", "01 10 02 00 00 02 04 46 16 00 00 1E 43", "01 10 02 00 00 02 40 70"),
            _quote(42, "become unit 5", "01 10 01 00 00 01 02 00 05 76 93", "05 10 01 00 00 01 01 B1"),
            _quote(42, "become unit 1 again", "05 10 01 00 00 01 02 00 01 45 90", "01 10 01 00 00 01 00 35"),
        ),
    ),
    Chapter(
        "V80 and PPC controllers, RTU 19200 8E1: all frames in the manual",
        (
            _quote(46, "40108-40110", "06 03 00 6B 00 03 75 A0", "06 03 06 00 63 00 63 00 63 73 7A", "uint16"),
            _quote(57, "coils 20-56", "11 01 00 13 00 25 0E 84", "11 01 05 CD 6B B2 0E 1B 45 E6", "bits"),
            _quote(57, "40108-40110", "11 03 00 6B 00 03 76 87", "11 03 06 02 2B 00 00 00 64 C8 BA", "uint16"),
            _quote(57, "coil 173 on", "11 05 00 AC FF 00 4E 8B", "11 05 00 AC FF 00 4E 8B"),
            _quote(57, "40136 = 039E", "11 06 00 87 03 9E BA 2B", "11 06 00 87 03 9E BA 2B"),
            _quote(57, "coils 20-29", "11 0F 00 13 00 0A 02 CD 00 7E CB", "11 0F 00 13 00 0A 26 99"),
            _quote(57, "40136-7 = 10, 258", "11 10 00 87 00 02 04 00 0A 01 02 4E BA", "11 10 00 87 00 02 F3 71"),
        ),
    ),
    Chapter(
        "Mint motion controller, ASCII 19200 7E1: its functions and its three exceptions",
        (
            DemoRequest(52, "write Comms 29-30", "10 00 1D 00 02 04 01 02 03 04", "10 00 1D 00 02"),
            DemoRequest(52, "read Comms 29-30", "03 00 1D 00 02", "03 04 01 02 03 04", "uint16"),
            DemoRequest(52, "both in one", "17 00 1D 00 01 00 1D 00 01 02 00 2A", "17 02 00 2A", "uint16"),
            DemoRequest(52, "output 3 on", "05 00 03 FF 00", "05 00 03 FF 00"),
            DemoRequest(52, "outputs 0-15", "01 00 00 00 10", "01 02 08 00", "bits"),
            DemoRequest(52, "inputs 0-15", "02 00 00 00 10", "02 02 00 00", "bits"),
            DemoRequest(52, "Comms 0 does not exist", "03 00 00 00 01", "83 02"),
            DemoRequest(52, "a coil is on or off", "05 00 03 12 34", "85 03"),
            DemoRequest(52, "no function 04", "04 00 01 00 01", "84 01"),
        ),
    ),
    Chapter(
        "A controller that is switched off: each request has its own time limit",
        (
            DemoRequest(53, "1 output", "01 00 00 00 01", "81 0B"),
            DemoRequest(53, "99 registers", "03 00 01 00 63", "83 0B"),
            DemoRequest(53, "1 register: a late response may come", "03 00 01 00 01", "83 0B"),
        ),
    ),
    Chapter(
        "Register image 200, answered by the gateway itself",
        (
            DemoRequest(200, "write 40001", "06 00 00 00 07", "06 00 00 00 07"),
            DemoRequest(200, "read 40001", "03 00 00 00 01", "03 02 00 07", "uint16"),
        ),
    ),
    Chapter(
        "Virtual unit 240: registers of all devices in one block, polled by the gateway",
        (
            DemoRequest(
                240,
                "three devices",
                "03 00 00 00 08",
                "03 10 45 9C 3D 51 00 63 00 63 00 63 02 2B 00 00 00 64",
                "float32, uint16",
            ),
        ),
    ),
)


def reading(shows: str, answer: bytes) -> str:
    """Show the values in a response, read as `shows` says, or its exception."""
    if answer[0] & 0x80:
        return f"exception {answer[1]:02X}"
    if shows == "float32, uint16":
        return f"{reading('float32', answer)}, {reading('uint16', answer[:2] + answer[6:])}"
    if shows == "float32":
        return f"{unpack('>f', answer[2:6])[0]:.2f}"
    if shows == "uint16":
        return ", ".join(str(int.from_bytes(answer[at : at + 2])) for at in range(2, len(answer), 2))
    if shows == "bits":
        bits = "".join(map(str, unpack_bits(answer[2:], 8 * answer[1])))
        return bits if len(bits) <= 16 else bits[:16] + "..."
    return "done"
