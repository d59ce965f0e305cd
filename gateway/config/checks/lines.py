"""Cross-checks of the keys of a line: its mode, its format, its role."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from gateway.config.plan.lines import spoken_on
from gateway.config.problem import Problem, error, warning
from gateway.config.schema.config import Config
from gateway.config.schema.line import Line
from gateway.config.values.address import DEFAULT_PORTS, Address
from gateway.config.values.character_format import fits_mode

#: Keys that exist for only one role of a line.
_ASKING_KEYS: Final = (
    *("turnaround", "queue", "max_wait", "retries", "retry_within", "rest", "coalesce", "broadcast", "lease"),
    *("idle", "after_connect", "wake"),
)
_CLIENT_KEYS: Final = ("devices", "profile", "timeout", "late_window", *_ASKING_KEYS)
_CONNECTION_KEYS: Final = ("idle", "after_connect")
_SERVER_KEYS: Final = ("serves", "on_failure", "answer_within", "broadcast_to")


def check_lines(config: Config) -> Iterator[Problem]:
    """Find keys of a line that do not fit its port, its mode or its role."""
    for line in config.line:
        yield from _check_device_server(line)
        yield from _check_format(line)
        yield from _check_role(line)


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


def _check_format(line: Line) -> Iterator[Problem]:
    if line.format is None:
        return
    if not fits_mode(line.format, spoken_on(line)):
        remedy = f'write "8{line.format.parity}{line.format.stop_bits}", or {other_mode(line)}'
        yield error((*line.path, "format"), "RTU needs 8 data bits", remedy)
    if spoken_on(line) == "ascii" and line.format.data_bits == 8 and line.format.parity != "N":
        remedy = 'most are set to "7E1", "7O1" or "8N1"'
        yield warning((*line.path, "format"), f"{line.format} is unusual for ASCII devices", remedy)


def _check_role(line: Line) -> Iterator[Problem]:
    if line.role == "monitor":
        for key in filter(line.has, (*_ASKING_KEYS, *_SERVER_KEYS)):
            yield error((*line.path, key), 'a line with role = "monitor" never transmits, and has no use for this key')
        return
    foreign = _CLIENT_KEYS if line.role == "server" else _SERVER_KEYS
    for key in filter(line.has, foreign):
        other = "client" if line.role == "server" else "server"
        yield error((*line.path, key), f'only a line with role = "{other}" has this key')
    if line.role == "server" and line.serves is None:
        yield error(
            (*line.path, "serves"), "serves is missing", "name the units that the gateway answers for: serves = [41]"
        )
