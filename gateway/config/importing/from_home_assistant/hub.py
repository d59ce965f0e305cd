"""A connection of Home Assistant as a line or an upstream, with the devices behind it."""

from decimal import Decimal
from typing import Final, Literal

from gateway.config.importing.from_home_assistant.device import DevicePart, Taken, devices_of
from gateway.config.importing.from_home_assistant.entities import KINDS
from gateway.config.importing.from_home_assistant.fields import Documents, Fields, fields_of
from gateway.config.importing.imported import ImportedFileError, address, milliseconds
from gateway.config.importing.points import ProfilePart
from gateway.config.problem import WrongValue
from gateway.config.reading.toml_text import Row, Rows, TableText, Value
from gateway.config.values.port import fits_mode, parse_format, parse_port

#: How long Home Assistant waits for a response, in seconds.
_TIMEOUT: Final = 3
_DEFAULT_NAME: Final = "modbus_hub"
_LONGEST_TIME: Final = 24 * 3600
_HIGHEST_PORT: Final = 0xFFFF
_HIGHEST_BAUD: Final = 100_000_000
#: Keys that say nothing of registers, or that are something else here.
_WITHOUT_MEANING: Final = frozenset(("close_comm_on_error", "retry_on_empty", "retries", "lazy_error_count", *KINDS))


def hub_parts(
    value: object, documents: Documents, taken: Taken
) -> tuple[list[TableText | ProfilePart], list[DevicePart]]:
    """Make the table of a connection and the profiles of its devices."""
    fields = fields_of(value, documents)
    try:
        return _parts(fields, documents, taken)
    except ImportedFileError as wrong:
        raise ImportedFileError(f"{fields.where}: {wrong}") from None


def _parts(
    fields: Fields, documents: Documents, taken: Taken
) -> tuple[list[TableText | ProfilePart], list[DevicePart]]:
    kind, keys, target = _connection(fields)
    hub = fields.text("name", _DEFAULT_NAME)
    if target in taken.targets:
        raise ImportedFileError(f"{target} is the connection of {taken.targets[target]} too")
    devices = devices_of(fields, hub, documents, taken, is_line=kind == "line")
    timeout = milliseconds(_milliseconds(fields, "timeout", 1000) or 1000 * _TIMEOUT)
    for device in devices:
        device.profile.keys["timeout"] = timeout
    taken.targets[target] = fields.where
    rows = Rows(tuple(Row(device.row(taken)) for device in devices))
    name = taken.name(f"{hub}-{kind}")
    table: dict[str, Value | Rows] = {"name": name, **keys, "devices" if kind == "line" else "units": rows}
    unread = ", ".join(fields.unread(_WITHOUT_MEANING))
    remarks = (f"ignored: {unread}",) if unread else ()
    profiles = [device.profile for device in devices]
    return [TableText(f"[[{kind}]]", table, (fields.where, *remarks)), *profiles], devices


def _connection(fields: Fields) -> tuple[Literal["line", "upstream"], dict[str, Value], str]:
    """Find the kind of table that a connection is, its keys, and what it is connected with."""
    kind = fields.text("type", "")
    delay, wait = _milliseconds(fields, "delay", 1000), _milliseconds(fields, "message_wait_milliseconds", 1)
    times: dict[str, Value] = {"gap": milliseconds(wait)} if wait else {}
    pause: dict[str, Value] = {"after_connect": milliseconds(delay)} if delay else {}
    if kind == "serial":
        port, keys = _serial(fields)
        return "line", keys | times | (pause if "://" in port else {}), port
    if kind not in ("tcp", "rtuovertcp"):
        raise ImportedFileError(f"type {kind} is not known here" if kind else "it has no type")
    host, number = fields.text("host", ""), fields.whole("port")
    if not host or number > _HIGHEST_PORT:
        raise ImportedFileError(f"{number} is no port" if host else "it has no host")
    target = str(address("tcp" if kind == "tcp" else "rtu+tcp", host, number, "host"))
    if kind == "tcp":
        return "upstream", {"to": target, "in_flight": 1, **times, **pause}, target
    return "line", {"port": target, **times, **pause}, target


def _serial(fields: Fields) -> tuple[str, dict[str, Value]]:
    """Find the port of a serial connection, and the keys for it."""
    port, mode = fields.text("port", ""), fields.text("method", "rtu").lower()
    if mode not in ("rtu", "ascii"):
        raise ImportedFileError(f"method {mode} is not known here")
    if port.startswith("socket://"):  # a device server, as pyserial names it
        port = f"{mode}+tcp://{port.removeprefix('socket://')}"
    parity = fields.text("parity", "E").upper()[:1]
    format_ = f"{fields.whole('bytesize', 8)}{parity}{fields.whole('stopbits', 1)}"
    baud = fields.whole("baudrate")
    try:
        parse_port(port)
        is_usable = fits_mode(parse_format(format_), "ascii" if mode == "ascii" else "rtu")
    except WrongValue as wrong:
        raise ImportedFileError(f"port: {wrong}") from None
    if not is_usable or not 0 < baud <= _HIGHEST_BAUD:
        raise ImportedFileError(f"a line with method {mode} cannot have {baud} Bd and {format_}")
    keys: dict[str, Value] = {"port": port, "baud": baud, "format": format_}
    return port, keys | ({"mode": "ascii"} if mode == "ascii" and "://" not in port else {})


def _milliseconds(fields: Fields, key: str, factor: int) -> float:
    """Return a time; `factor` is how many milliseconds its unit has."""
    number = (fields.number(key) or Decimal(0)) * factor
    if not 0 <= number <= 1000 * _LONGEST_TIME:
        raise ImportedFileError(f"{key} must be from 0 to a day")
    return float(number)
