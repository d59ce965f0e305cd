"""`simulate`: simulated devices on a virtual serial port."""

import argparse
import asyncio
import json
import signal
import sys
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

from gateway.cli.kit.usage import baud
from gateway.cli.main import FINE, WRONG_USAGE
from gateway.clock.exact_loop import run_exactly
from gateway.config.problem import WrongValue, did_you_mean
from gateway.config.values.character_format import DEFAULT_FORMATS, parse_format
from gateway.config.values.duration import parse_duration
from gateway.config.values.unitset import parse_units, show_units
from gateway.simulator.broken import FAULTS, line_faults, with_faults
from gateway.simulator.device import Device, Mode
from gateway.simulator.faults import Faults
from gateway.simulator.kinds import KINDS
from gateway.simulator.line import SimulatedLine
from gateway.simulator.paced_line import Sender, Tell, ignore_frame
from gateway.simulator.weigher import PRINTED_WEIGHT, Weigher
from gateway.timing.characters import CharacterFormat

#: The rate in the printed config: the one in the device's manual.
_USUAL_BAUD: Final = {"weigher": 9600}
_DEFAULT_BAUD: Final = 19200

_ENDING_SIGNALS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


_ARROWS: Final[Mapping[Sender, str]] = {"port": ">>", "device": "<<"}

_T = TypeVar("_T")


class _Group(NamedTuple):
    """Devices of one kind."""

    kind: str
    units: tuple[int, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `simulate`."""
    add = parser.add_argument
    add("profile", nargs="+", type=_group, metavar="PROFILE[:UNITS]", help=f"{', '.join(KINDS)}; several share a line")
    add("--port", required=True, type=Path, metavar="PATH", help="path of the virtual serial port")
    add("--unit", type=_units, default=(1,), metavar="UNITS", help="such as 2, 1-3 or 6,17 (default 1)")
    add("--mode", choices=("rtu", "ascii"), help="mode of the line (default rtu, mint ascii)")
    add("--format", type=_format, metavar="F", help="character format (default 8E1, ASCII 7E1)")
    add("--baud", type=baud, metavar="N", help="baud rate of the devices (default: as set on the port)")
    add("--weight", type=float, metavar="W", help="constant weight of the weighers")
    add(
        "--moving-unit",
        type=_units,
        default=(),
        metavar="UNITS",
        help="weighers whose weight changes, regardless of --weight",
    )
    add("--silent", action="store_true", help="no device responds")
    add("--silent-unit", type=_units, default=(), metavar="UNITS", help="devices that do not respond")
    add(
        "--fault",
        type=_fault_words,
        default=frozenset(),
        metavar="WORD[,WORD...]",
        help=f"what is wrong with the line, for doctor to find: {', '.join(FAULTS)}",
    )
    add("--slow", type=_duration, default=0.0, metavar="TIME", help='respond later, such as "200 ms"')
    add("--noise", type=_share, default=0.0, metavar="SHARE", help="damage some responses, such as 5%%")
    add("--seed", type=int, default=0, metavar="N", help="seed of the noise (default 0)")
    add("-v", "--verbose", action="store_true", help="print each frame")


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGINT or SIGTERM; 2 if the devices cannot be on one line.

    Raises:
        PortError: the port cannot be created at the path.
    """
    groups = [_Group(kind, units or args.unit) for kind, units in args.profile]
    mode: Mode = args.mode or ("ascii" if groups[0].kind == "mint" else "rtu")
    format_ = args.format or DEFAULT_FORMATS[mode]
    end = asyncio.Event()
    tell = _print_frames(mode, end) if args.verbose else ignore_frame
    try:
        devices = with_faults(_devices(groups, args), args.fault, _shown_baud(groups, args))
        faults = line_faults(args.fault)
        line = SimulatedLine(args.port, devices, mode=mode, format_=format_, seed=args.seed, tell=tell, faults=faults)
    except ValueError as wrong:
        print(f"modbus-gateway simulate: error: {wrong}", file=sys.stderr)
        return WRONG_USAGE
    pace = "rate as set on the port" if args.baud is None else f"{args.baud} baud"
    ready = f"{_name_groups(groups)} at {args.port}: {mode} {format_}, {pace}. Press Ctrl-C to stop."
    run_exactly(_serve(line, f"{ready}\n\n{_write_line(groups, args, mode, format_)}\n", end))
    return FINE


async def _serve(line: SimulatedLine, introduction: str, end: asyncio.Event) -> None:
    loop = asyncio.get_running_loop()
    for number in _ENDING_SIGNALS:
        loop.add_signal_handler(number, end.set)
    async with line:
        print(introduction, flush=True)
        await end.wait()


def _devices(groups: list[_Group], args: argparse.Namespace) -> list[Device]:
    """Make the devices that the arguments name.

    Raises:
        ValueError: they cannot be on one line.
    """
    units = [unit for group in groups for unit in group.units]
    for unit in units:
        if units.count(unit) > 1:
            raise ValueError(f"two devices have the address {unit}; --fault duplicate-address does that on purpose")
    for named in (*args.silent_unit, *args.moving_unit):
        if named not in units:
            raise ValueError(f"there is no unit {named} on this line; it has {show_units(units)}")
    return [_device(group.kind, unit, args) for group in groups for unit in group.units]


def _device(kind: str, unit: int, args: argparse.Namespace) -> Device:
    faults = Faults(silent=args.silent or unit in args.silent_unit, slow=args.slow, noise=args.noise)
    if kind != "weigher":
        return KINDS[kind](unit, baud=args.baud, faults=faults)
    weight = PRINTED_WEIGHT if args.weight is None else args.weight
    moves = args.weight is None or unit in args.moving_unit
    return Weigher(unit, weight=weight, moves=moves, baud=args.baud, faults=faults)


def _print_frames(mode: Mode, end: asyncio.Event) -> Tell:
    """Make a function that prints each frame with its starting time, and sets `end` if the output is closed."""

    def tell(sender: Sender, data: bytes) -> None:
        text = data.hex(" ").upper() if mode == "rtu" else ascii(data.decode("latin-1"))[1:-1]
        now = datetime.now().astimezone().time().isoformat("milliseconds")
        try:
            print(f"{now} {_ARROWS[sender]} {text}", flush=True)
        except BrokenPipeError:
            end.set()

    return tell


def _name_groups(groups: list[_Group]) -> str:
    """Name the devices: `weigher 1-2, v80 6`."""
    return ", ".join(f"{group.kind} {show_units(group.units)}" for group in groups)


def _write_line(groups: list[_Group], args: argparse.Namespace, mode: Mode, format_: CharacterFormat) -> str:
    """Write the `[[line]]` table for these devices, with this rate or the usual one."""
    port = args.port.absolute()
    baud = _shown_baud(groups, args)
    rows = [
        f"  {{ unit = {units if units.isdecimal() else json.dumps(units)}, profile = {json.dumps(group.kind)} }},"
        for group in groups
        for units in show_units(group.units).split(", ")
    ]
    usual = f"  # as in the manual of a {groups[0].kind}; here any rate will do" if _is_manuals(groups, args) else ""
    keys = {"name": port.name, "port": str(port), "mode": mode, "baud": baud, "format": str(format_)}
    lines = [
        f"{key} = {json.dumps(value, ensure_ascii=False)}{usual if key == 'baud' else ''}"
        for key, value in keys.items()
    ]
    return "\n".join(["[[line]]", *lines, "devices = [", *rows, "]"])


def _is_manuals(groups: list[_Group], args: argparse.Namespace) -> bool:
    """Tell whether the rate in the config that is shown is that of a manual, and the devices have none."""
    return args.baud is None and groups[0].kind in _USUAL_BAUD


def _shown_baud(groups: list[_Group], args: argparse.Namespace) -> int:
    """Choose the rate in the config that is shown."""
    return args.baud or _USUAL_BAUD.get(groups[0].kind, _DEFAULT_BAUD)


def _fault_words(text: str) -> frozenset[str]:
    words = [word.strip() for word in text.split(",")]
    for word in words:
        if word not in FAULTS:
            raise argparse.ArgumentTypeError(f'there is no fault "{word}"; {did_you_mean(word, FAULTS)}')
    return frozenset(words)


def _group(text: str) -> tuple[str, tuple[int, ...] | None]:
    """Parse `PROFILE[:UNITS]`."""
    kind, colon, units = text.partition(":")
    if kind not in KINDS:
        raise argparse.ArgumentTypeError(f'there is no profile "{kind}" to simulate; {did_you_mean(kind, KINDS)}')
    return kind, _units(units) if colon else None


def _units(text: str) -> tuple[int, ...]:
    return _parse_argument(parse_units, [part.strip() for part in text.split(",")])


def _format(text: str) -> CharacterFormat:
    return _parse_argument(parse_format, text)


def _duration(text: str) -> float:
    return _parse_argument(parse_duration, text)


def _share(text: str) -> float:
    """Parse 5% or 0.05."""
    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = -1.0
    if not 0 <= share <= 1:
        raise argparse.ArgumentTypeError(f'"{text}" is not a valid percentage; write one such as 5%')
    return share


def _parse_argument(parse: Callable[[object], _T], value: object) -> _T:
    """Parse a value, with errors as argparse expects them."""
    try:
        return parse(value)
    except WrongValue as wrong:
        remedy = f": {wrong.remedy}" if wrong.remedy else ""
        raise argparse.ArgumentTypeError(f"{wrong}{remedy}") from wrong
