"""Cross-checks of the keys of a line: its mode, its format, its role."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gateway.config.plan.lines import spoken_on
from gateway.config.problem import Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.values.address import DEFAULT_PORTS, Address
from gateway.config.values.port import VIRTUAL_FORMAT, fits_mode
from gateway.modbus.codes import BROADCAST_UNIT

#: Keys that exist for only one role of a line.
_ASKING_KEYS: Final = (
    *("turnaround", "queue", "max_wait", "retries", "retry_within", "rest", "coalesce", "broadcast", "lease"),
    *("idle", "after_connect", "wake"),
)
_CLIENT_KEYS: Final = ("devices", "profile", "timeout", "late_window", *_ASKING_KEYS)
_CONNECTION_KEYS: Final = ("idle", "after_connect")
_SERVER_KEYS: Final = ("serves", "on_failure", "answer_within", "broadcast_to")
_SENDING_KEYS: Final = (*_ASKING_KEYS, *_SERVER_KEYS, "gap", "echo")


def check_lines(config: Config) -> Iterator[Problem]:
    """Find keys of a line that do not fit its port, its mode or its role."""
    for line in config.line:
        yield from _check_device_server(line)
        yield from _check_format(line)
        yield from _check_rs485_delay(line)
        yield from _check_role(line)
        yield from _check_virtual_port(line)


def other_mode(line: Line) -> str:
    """Say how to write the other mode for a line."""
    other = "rtu" if spoken_on(line) == "ascii" else "ascii"
    return f"{other}+tcp:// in port" if isinstance(line.port, Address) else f'mode = "{other}"'


def _check_device_server(line: Line) -> Iterator[Problem]:
    """Find keys without effect on a device server: its address sets the mode, and it drives its own serial line."""
    if not isinstance(line.port, Address):
        for key in filter(line.has, _CONNECTION_KEYS):
            yield error((*line.path, key), "is for lines behind a device server", "take it out")
        return
    if line.idle and line.lease is not None:
        remedy = "take idle out: who holds a lease has to hear whether another gateway asks"
        yield error((*line.path, "idle"), "a line with a lease keeps its connection", remedy)
    if line.has("mode") and line.mode != spoken_on(line):
        remedy = f'leave mode out, or write port = "{replace(line.port, scheme=f"{line.mode}+tcp")}"'
        yield error((*line.path, "mode"), f"{line.port.scheme}:// carries {spoken_on(line).upper()}", remedy)
    if line.port.port == DEFAULT_PORTS["tcp"]:
        what = f"port 502 is that of Modbus TCP, and {line.port.scheme}:// sends bare {spoken_on(line).upper()} frames"
        remedy = f'if the server speaks Modbus TCP: [[upstream]] with to = "{replace(line.port, scheme="tcp")}"'
        yield warning((*line.path, "port"), what, remedy)
    if line.rs485 == "kernel":
        remedy = 'set RS-485 in the device server, and leave rs485 out or "adapter"'
        yield error((*line.path, "rs485"), "a device server controls its own driver", remedy)


def _check_rs485_delay(line: Line) -> Iterator[Problem]:
    if line.rs485_delay is not None and line.rs485 != "kernel":
        remedy = 'take it out, or write rs485 = "kernel" if the driver switches the transmitter'
        yield error((*line.path, "rs485_delay"), 'has no meaning: it is for rs485 = "kernel"', remedy)


def _check_format(line: Line) -> Iterator[Problem]:
    if line.format is None:
        return
    if not fits_mode(line.format, spoken_on(line)):
        remedy = f'write "8{line.format.parity}{line.format.stop_bits}", or {other_mode(line)}'
        yield error((*line.path, "format"), "RTU needs 8 data bits", remedy)
    if spoken_on(line) == "ascii" and line.format.data_bits == 8 and line.format.parity != "N":
        remedy = 'most are set to "7E1", "7O1" or "8N1"'
        yield warning((*line.path, "format"), f"{line.format} is unusual for ASCII devices", remedy)


def _check_monitor(line: Line) -> Iterator[Problem]:
    """Find what a line that only listens cannot have."""
    only_listens = 'a line with role = "monitor" only listens'
    for key in filter(line.has, _SENDING_KEYS):
        yield error((*line.path, key), f"has no meaning: {only_listens}", "take it out")
    if line.rs485 == "kernel":
        yield error((*line.path, "rs485"), f"would switch a driver on, and {only_listens}", "take it out")
    for row in line.devices or ():
        for key in filter(row.has, ("priority", "wake")):
            yield error((*row.path, key), f"has no meaning: {only_listens}", "take it out")
        if BROADCAST_UNIT in row.units:
            what = 'on a line with role = "monitor", a device is known by its own address, and 0 is everybody\'s'
            yield error((*row.path, "unit"), what, "name its address: the trace of the line shows it")
    if line.devices == ():
        yield error((*line.path, "devices"), "is empty", "leave it out: the trace shows every unit that is heard")


def _check_virtual_port(line: Line) -> Iterator[Problem]:
    """Find a virtual port where no program could use it, and keys that need an adapter, or are for virtual ports."""
    if not line.is_virtual:
        if line.has("group"):
            remedy = "take it out: the port of an adapter has its group from udev"
            yield error((*line.path, "group"), "is for virtual ports", remedy)
        return
    if line.role != "server":
        remedy = 'role = "server", if programs of this machine ask there; to ask devices, name the port of an adapter'
        yield error((*line.path, "port"), "a virtual port has programs at its other end, and no devices", remedy)
    if line.rs485 == "kernel":
        yield error((*line.path, "rs485"), "a virtual port has no driver to control", "leave rs485 out")
    if line.echo:
        yield error((*line.path, "echo"), "a virtual port echoes nothing", "leave echo out")
    if line.format not in (None, VIRTUAL_FORMAT):
        remedy = f"set the programs to {VIRTUAL_FORMAT}, and leave format out"
        yield warning((*line.path, "format"), f"a virtual port carries {VIRTUAL_FORMAT} only", remedy)


def _check_role(line: Line) -> Iterator[Problem]:
    if line.role == "monitor":
        yield from _check_monitor(line)
        return
    foreign = _CLIENT_KEYS if line.role == "server" else _SERVER_KEYS
    for key in filter(line.has, foreign):
        other = "client" if line.role == "server" else "server"
        yield error((*line.path, key), f'only a line with role = "{other}" has this key')
    if line.role == "server" and line.serves is None:
        remedy = 'name the units that the gateway answers for: serves = [41]; or serves = "all"'
        yield error((*line.path, "serves"), "serves is missing", remedy)
