"""`simulate`: simulated devices on a virtual serial port, or behind a Modbus TCP server."""

import argparse
import asyncio
import json
import re
import signal
from collections.abc import Callable, Mapping
from contextlib import AbstractAsyncContextManager
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import Final

from gateway.cli.kit.usage import WrongUsageError, baud, parsed_by
from gateway.cli.main import FINE
from gateway.cli.units.simulated import Group, Setting, find_groups, make_devices
from gateway.clock.exact_loop import run_exactly
from gateway.config.problem import did_you_mean
from gateway.config.values.address import parse_address
from gateway.config.values.duration import parse_duration
from gateway.config.values.port import DEFAULT_FORMATS, parse_format
from gateway.config.values.unitset import parse_units, show_units
from gateway.simulator.broken import FAULTS, OF_DEVICES, line_faults, with_faults
from gateway.simulator.device import Device, Mode
from gateway.simulator.line import SimulatedLine
from gateway.simulator.paced_line import Sender, Tell, ignore_frame
from gateway.simulator.server import SimulatedServer
from gateway.timing.characters import CharacterFormat

#: The rate in the printed config: the one in the device's manual.
_USUAL_BAUD: Final = {"weigher": 9600}
_DEFAULT_BAUD: Final = 19200

_ENDING_SIGNALS: Final = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


_ARROWS: Final[Mapping[Sender, str]] = {"port": ">>", "device": "<<"}

_SETTING: Final = re.compile(r"(?:([0-9]{1,3}):)?([^:=]+)=(.*)", re.DOTALL)


_ABOUT: Final = """\
mint, v80 and weigher are played as in their documents. Any other profile has
plausible values at its points, within min and max; most change slowly. What is
written stays.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `simulate`."""
    add = parser.add_argument
    parser.epilog = _ABOUT
    add("profile", nargs="+", type=_group, metavar="PROFILE[:UNITS]", help="any profile; several share a line")
    place = parser.add_mutually_exclusive_group(required=True)
    place.add_argument("--port", type=Path, metavar="PATH", help="path of the virtual serial port")
    place.add_argument("--tcp", type=_tcp, metavar="HOST:PORT", help="address of a Modbus TCP server instead")
    add("--config", type=Path, metavar="FILE", help="config whose profiles are meant too")
    add(
        "--set",
        type=_setting,
        action="append",
        default=[],
        metavar="[UNIT:]POINT=VALUE",
        help="fixed value of a point; the word invalid where it has none; several times",
    )
    add("--unit", type=_units, default=(1,), metavar="UNITS", help="such as 2, 1-3 or 6,17 (default 1)")
    add("--mode", choices=("rtu", "ascii"), help="mode of the line (default: of the profile, or rtu)")
    add("--format", type=parsed_by(parse_format), metavar="F", help="character format (default 8E1, ASCII 7E1)")
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
    add("--slow", type=parsed_by(parse_duration), default=0.0, metavar="TIME", help='respond later, such as "200 ms"')
    add("--noise", type=_share, default=0.0, metavar="SHARE", help="damage some responses, such as 5%%")
    add("--seed", type=int, default=0, metavar="N", help="seed of values and noise (default 0)")
    add("-v", "--verbose", action="store_true", help="print each frame")


def run(args: argparse.Namespace) -> int:
    """Simulate until SIGINT or SIGTERM; 2 if the devices cannot be on one line."""
    end = asyncio.Event()
    try:
        groups = find_groups(((name, units or args.unit) for name, units in args.profile), args.config)
        devices = with_faults(make_devices(groups, args), args.fault, _shown_baud(groups, args))
        if args.tcp is not None:
            _check_has_no_line(args)
            tell = _print_frames("rtu", end) if args.verbose else ignore_frame
            server = SimulatedServer(args.tcp.host, args.tcp.port, devices, tell=tell)
            place: AbstractAsyncContextManager[object] = server
            introduction = partial(_introduce_server, server, groups)
        else:
            line = _line(groups, devices, args, end)
            place, introduction = line, partial(_introduce_line, groups, args)
    except ValueError as wrong:
        raise WrongUsageError(str(wrong)) from wrong
    run_exactly(_serve(place, introduction, end))
    return FINE


async def _serve(
    place: AbstractAsyncContextManager[object], introduction: Callable[[], str], end: asyncio.Event
) -> None:
    loop = asyncio.get_running_loop()
    for number in _ENDING_SIGNALS:
        loop.add_signal_handler(number, end.set)
    async with place:
        print(introduction(), flush=True)
        await end.wait()


def _line(groups: list[Group], devices: list[Device], args: argparse.Namespace, end: asyncio.Event) -> SimulatedLine:
    mode, format_ = _mode_and_format(groups, args)
    tell = _print_frames(mode, end) if args.verbose else ignore_frame
    faults = line_faults(args.fault)
    return SimulatedLine(args.port, devices, mode=mode, format_=format_, seed=args.seed, tell=tell, faults=faults)


def _mode_and_format(groups: list[Group], args: argparse.Namespace) -> tuple[Mode, CharacterFormat]:
    mode: Mode = args.mode or groups[0].mode or "rtu"
    return mode, args.format or DEFAULT_FORMATS[mode]


def _introduce_line(groups: list[Group], args: argparse.Namespace) -> str:
    mode, format_ = _mode_and_format(groups, args)
    pace = "rate as set on the port" if args.baud is None else f"{args.baud} baud"
    ready = f"{_name_groups(groups)} at {args.port}: {mode} {format_}, {pace}. Press Ctrl-C to stop."
    return f"{ready}\n\n{_write_line(groups, args, mode, format_)}\n"


def _introduce_server(server: SimulatedServer, groups: list[Group]) -> str:
    host, port = server.address
    address = f"tcp://[{host}]:{port}" if ":" in host else f"tcp://{host}:{port}"
    table = "\n".join(["[[upstream]]", f"to = {json.dumps(address)}", "units = [", *_rows(groups), "]"])
    return f"{_name_groups(groups)} at {address}. Press Ctrl-C to stop.\n\n{table}\n"


def _check_has_no_line(args: argparse.Namespace) -> None:
    """Check that nothing is set that only a line has."""
    for option in ("mode", "format", "baud", "noise"):
        if getattr(args, option):
            raise WrongUsageError(f"--{option} is for a line, and --tcp has none", "leave it out, or use --port")
    for word in sorted(args.fault - OF_DEVICES):
        raise WrongUsageError(
            f"--fault {word} is for a line, and --tcp has none", f"with --tcp: {', '.join(OF_DEVICES)}"
        )


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


def _name_groups(groups: list[Group]) -> str:
    """Name the devices: `weigher 1-2, v80 6`."""
    return ", ".join(f"{group.name} {show_units(group.units)}" for group in groups)


def _write_line(groups: list[Group], args: argparse.Namespace, mode: Mode, format_: CharacterFormat) -> str:
    """Write the `[[line]]` table for these devices, with this rate or the usual one."""
    port = args.port.absolute()
    baud = _shown_baud(groups, args)
    usual = f"  # as in the manual of a {groups[0].name}; here any rate will do" if _is_manuals(groups, args) else ""
    keys = {"name": port.name, "port": str(port), "mode": mode, "baud": baud, "format": str(format_)}
    lines = [
        f"{key} = {json.dumps(value, ensure_ascii=False)}{usual if key == 'baud' else ''}"
        for key, value in keys.items()
    ]
    return "\n".join(["[[line]]", *lines, "devices = [", *_rows(groups), "]"])


def _rows(groups: list[Group]) -> list[str]:
    """Write the rows of these devices for a config."""
    return [
        f"  {{ unit = {units if units.isdecimal() else json.dumps(units)}, profile = {json.dumps(group.name)} }},"
        for group in groups
        for units in show_units(group.units).split(", ")
    ]


def _is_manuals(groups: list[Group], args: argparse.Namespace) -> bool:
    """Tell whether the rate in the config that is shown is that of a manual, and the devices have none."""
    return args.baud is None and groups[0].name in _USUAL_BAUD


def _shown_baud(groups: list[Group], args: argparse.Namespace) -> int:
    """Choose the rate in the config that is shown."""
    return args.baud or _USUAL_BAUD.get(groups[0].name, _DEFAULT_BAUD)


def _fault_words(text: str) -> frozenset[str]:
    words = [word.strip() for word in text.split(",")]
    for word in words:
        if word not in FAULTS:
            raise argparse.ArgumentTypeError(f'there is no fault "{word}"; {did_you_mean(word, FAULTS)}')
    return frozenset(words)


def _group(text: str) -> tuple[str, tuple[int, ...] | None]:
    """Parse `PROFILE[:UNITS]`."""
    name, colon, units = text.partition(":")
    return name, _units(units) if colon else None


def _setting(text: str) -> Setting:
    """Parse `POINT=VALUE` or `UNIT:POINT=VALUE`."""
    match = _SETTING.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f'"{text}" sets nothing; write POINT=VALUE or UNIT:POINT=VALUE')
    return Setting(None if match[1] is None else int(match[1]), match[2], match[3])


_tcp = parsed_by(lambda text: parse_address(f"tcp://{str(text).removeprefix('tcp://')}", ("tcp",)))
_units = parsed_by(lambda text: parse_units([part.strip() for part in str(text).split(",")]))


def _share(text: str) -> float:
    """Parse 5% or 0.05."""
    try:
        share = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        share = -1.0
    if not 0 <= share <= 1:
        raise argparse.ArgumentTypeError(f'"{text}" is not a valid percentage; write one such as 5%')
    return share
