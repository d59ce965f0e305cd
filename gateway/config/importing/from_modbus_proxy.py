"""A config out of that of modbus-proxy (tiagocoutinho/modbus-proxy): YAML, TOML or JSON with a list of devices.

A device there has an address of its own at which clients ask for it, and any units behind it. Here it is an upstream
or, if RTU or ASCII is spoken with it, a line, with a listener that leads to it alone: clients keep their unit IDs.
"""

import json
import tomllib
from collections.abc import Collection, Iterator, Mapping
from pathlib import PurePath
from typing import Any, Final
from urllib.parse import SplitResult, parse_qs, urlsplit

from gateway.config.importing.imported import (
    Imported,
    ImportedFileError,
    Taken,
    address,
    gather,
    listen_address,
    milliseconds,
)
from gateway.config.importing.yaml_text import parse_yaml
from gateway.config.problem import WrongValue
from gateway.config.reading.toml_text import TableText, Value
from gateway.config.values.address import Address
from gateway.config.values.port import fits_mode, parse_format, parse_port
from gateway.config.values.unitset import show_units
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT, LAST_UNIT

#: What it waits for a device when nothing else is said, in seconds; requests wait for their turn as long as they must.
_TIMEOUT: Final = 10.0
_MAX_WAIT: Final = "1 min"
#: Units on a line, and those that `unit0` may name.
_ON_A_LINE: Final = range(FIRST_UNIT, LAST_UNIT + 1)
_UNIT0: Final = frozenset({*_ON_A_LINE, HIGHEST_UNIT})
#: What is spoken with the device over TCP, by the scheme of its url, and the schemes of serial ports.
_OVER_TCP: Final[Mapping[str, str]] = {
    **dict.fromkeys(("tcp", "tcp+tcp"), "tcp"),
    **dict.fromkeys(("tcp+rtu", "rtu+tcp"), "rtu+tcp"),
    **dict.fromkeys(("tcp+ascii", "ascii+tcp"), "ascii+tcp"),
}
_SERIAL: Final = frozenset({"serial", "serial+rtu", "rtu"})
_REPEATS: Final = "modbus-proxy repeated writes too; here only reads are sent again"
_SAME_PROTOCOL: Final = "as before, clients use the protocol of the device; for Modbus TCP write tcp:// in bind"


def config_from_modbus_proxy(file: str, text: str) -> Imported:
    """Write the config that does what modbus-proxy does with this `file`, which has this `text`."""
    document, taken = _document(file, text), Taken()
    tables = [*enumerate(document["devices"], start=1)]
    remapped = (number for number, table in tables if isinstance(table, dict) and table.get("unit_id_remapping"))
    first = next(remapped, 0)
    return gather(
        (f"From modbus-proxy: {file}", _REPEATS, *_unknown(document, {"devices", "logging"})),
        (_tables(table, f"{file}: device {number}", taken, may_remap=number == first) for number, table in tables),
    )


def _document(file: str, text: str) -> dict[str, Any]:
    try:
        document = _parsed(PurePath(file).suffix.lower(), text)
    except (ValueError, RecursionError) as wrong:
        raise ImportedFileError(f"{file}: {wrong}") from None
    devices = document.get("devices") if isinstance(document, dict) else None
    if not isinstance(devices, list) or not devices:
        raise ImportedFileError(f"{file}: there is no list of devices in it")
    return dict(document)


def _parsed(kind: str, text: str) -> Any:
    """Parse the document in a text.

    Raises:
        ValueError: it is not valid.
    """
    if kind == ".toml":
        return tomllib.loads(text)
    if kind == ".json":
        return json.loads(text)
    return parse_yaml(text)


def _tables(table: Any, where: str, taken: Taken, *, may_remap: bool) -> Iterator[TableText]:
    """Make a listener, and the upstream or the line that it leads to."""
    modbus, listen = _part(table, "modbus", where), _part(table, "listen", where)
    target, keys = _target(_url(modbus, "url", where), f"{where}: url")
    spoken = target.scheme if isinstance(target, Address) else "rtu+tcp"
    place = _url(listen, "bind", where)
    bind = listen_address(spoken, place.hostname or "", _port(place), f"{where}: bind")
    name = taken.name(f"{target.host}-{target.port}" if isinstance(target, Address) else target.rsplit("/", 1)[-1])
    kind = "upstream" if spoken == "tcp" else "line"
    door: dict[str, Value] = {"name": name, "bind": str(bind), kind: name, "idle": "0"}
    keys = {"name": name, **keys, **_times(modbus, where, has_connection=isinstance(target, Address))}
    remarks = [*_unknown(table, {"modbus", "listen", "unit_id_remapping"})]
    remarks += [*_unknown(modbus, {"url", "timeout", "connection_time"}), *_unknown(listen, {"bind"})]
    remarks += [] if kind == "upstream" else [_SAME_PROTOCOL]
    units = _remapped(table.get("unit_id_remapping") or {}, range(256) if kind == "upstream" else _ON_A_LINE, where)
    if units:
        if not may_remap:
            raise ImportedFileError(f"{where}: unit_id_remapping: a gateway can do that for one device only")
        del door[kind]
        stands_for = next((unit for unit, to in units.items() if unit in _UNIT0 and to == units.get(0)), None)
        door |= {} if stands_for is None else {"unit0": stands_for}
        lost = {*range(256)} - {unit for unit in units if unit or stands_for}
        keys["units" if kind == "upstream" else "devices"] = _rows({unit: units[unit] for unit in units if unit})
        remarks += [f"clients cannot ask for unit{'s' * (len(lost) > 1)} {show_units(lost)} any more"] if lost else []
    taken.take(bind, target, where)
    yield TableText("[[listen]]", door, (where, *remarks))
    yield TableText(f"[[{kind}]]", keys)


def _rows(units: Mapping[int, int]) -> list[Value]:
    """Put units that keep their numbers in one row, and each other one in a row of its own."""
    runs = show_units(unit for unit, to in units.items() if unit == to).split(", ")
    same: list[Value] = [int(run) if run.isdecimal() else run for run in runs]
    rows: list[Value] = [{"as": same, "unit": same}]
    return rows + [{"as": unit, "unit": to} for unit, to in units.items() if unit != to]


def _times(modbus: Mapping[str, Any], where: str, *, has_connection: bool) -> dict[str, Value]:
    """Make the keys for its times."""
    pause = _seconds(modbus.get("connection_time"), 0.0, f"{where}: connection_time")
    timeout = max(_seconds(modbus.get("timeout"), _TIMEOUT, f"{where}: timeout"), 0.001)
    keys: dict[str, Value] = {"timeout": milliseconds(1000 * timeout), "max_wait": _MAX_WAIT}
    return keys | ({"after_connect": milliseconds(1000 * pause)} if pause and has_connection else {})


def _part(table: Any, key: str, where: str) -> dict[str, Any]:
    part = table.get(key) if isinstance(table, dict) else None
    if not isinstance(part, dict):
        raise ImportedFileError(f"{where}: it has no {key}")
    return part


def _unknown(table: Mapping[str, Any], known: Collection[str]) -> Iterator[str]:
    return (f"modbus-proxy had {key}, which is not known here" for key in table if key not in known)


def _url(table: Mapping[str, Any], key: str, where: str) -> SplitResult:
    value = table.get(key)
    if not isinstance(value, str):
        raise ImportedFileError(f"{where}: it has no {key}" if value is None else f"{where}: {key} must be text")
    usual = "serial" if value.startswith("/") else "tcp"
    try:
        url = urlsplit(value if "://" in value else f"{usual}://{value}")
        _ = url.port, url.hostname
    except ValueError as wrong:
        raise ImportedFileError(f"{where}: {key}: {wrong}") from None
    return url


def _seconds(value: Any, usual: float, where: str) -> float:
    if value is None:
        return usual
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= 24 * 3600:
        raise ImportedFileError(f"{where} must be a number of seconds")
    return float(value)


def _remapped(table: Any, there: range, where: str) -> dict[int, int]:
    """Find what each unit of clients is `there`; nothing if no unit has another number."""
    if not isinstance(table, dict):
        raise ImportedFileError(f"{where}: unit_id_remapping must be pairs of units")
    units = {unit: unit for unit in range(256)} if table else {}
    for pair in table.items():
        known_as, unit = (int(each) if isinstance(each, str) and each.isdecimal() else each for each in pair)
        if not all(type(each) is int and 0 <= each <= 255 for each in (known_as, unit)):
            raise ImportedFileError(f"{where}: unit_id_remapping: a unit is a number from 0 to 255")
        units[known_as] = unit
    return {unit: to for unit, to in units.items() if to in there}


def _target(url: SplitResult, where: str) -> tuple[str | Address, dict[str, Value]]:
    """Find the serial port or the server of a device, and the keys that say so."""
    if url.scheme in _SERIAL and not url.hostname and url.path:
        return url.path, _serial(url, where)
    if url.scheme not in _OVER_TCP:
        raise ImportedFileError(f"{where}: {url.scheme}:// is not known here")
    if url.path.strip("/"):
        raise ImportedFileError(f"{where}: {url.path} behind an address means nothing")
    host = "127.0.0.1" if url.hostname in (None, "0") else url.hostname
    to = address(_OVER_TCP[url.scheme], host, _port(url), where)
    if to.is_wildcard or not to.port:
        raise ImportedFileError(f"{where}: {to} is not the address of a device")
    return to, {"to": str(to), "in_flight": 1, "retries": 1} if to.scheme == "tcp" else {"port": str(to)}


def _serial(url: SplitResult, where: str) -> dict[str, Value]:
    options = {key: values[-1] for key, values in parse_qs(url.query).items()}
    baud, letters = options.get("baudrate", "9600"), options.get("parity", "N")[:1].upper()
    format_ = f"{options.get('bytesize', '8')}{letters}{options.get('stopbits', '1')}"
    try:
        is_usable = fits_mode(parse_format(format_), "rtu") and baud.isdecimal() and 0 < int(baud) <= 100_000_000
        is_usable = is_usable and isinstance(parse_port(url.path), str)
    except WrongValue as wrong:
        raise ImportedFileError(f"{where}: {wrong}") from None
    if not is_usable:
        raise ImportedFileError(f"{where}: its settings are not those of an RTU line")
    return {"port": url.path, "baud": int(baud), "format": format_}


def _port(url: SplitResult) -> int:
    return 502 if url.port is None else url.port
