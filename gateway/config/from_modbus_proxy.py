"""A config out of that of modbus-proxy (tiagocoutinho/modbus-proxy): YAML, TOML or JSON with a list of devices.

A device there has an address of its own at which clients ask for it, and any units behind it. Our listeners lead to
all units, so units of several Modbus TCP devices get numbers of their own. A serial or RTU over TCP device becomes a
line with a listener for it alone, and nothing changes for its clients.
"""

import json
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any, Final, NamedTuple
from urllib.parse import SplitResult, parse_qs, urlsplit

from gateway.config.address import Address
from gateway.config.character_format import fits_mode, parse_format
from gateway.config.imported import (
    OPEN_ACCESS,
    ImportedFileError,
    Taken,
    address,
    left_out,
    listen_address,
    milliseconds,
)
from gateway.config.port import parse_port
from gateway.config.problem import WrongValue
from gateway.config.toml_text import TableText, Value, file_text
from gateway.config.unitset import show_units
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT, SERVER_UNIT

#: What it waits for a device when nothing else is said, in seconds.
_TIMEOUT: Final = 10.0
_NO_LIBRARY: Final = (
    "to read YAML, the library ruamel.yaml is needed. In a checkout: .venv/bin/pip install ruamel.yaml; with pipx: "
    "pipx inject mbgw ruamel.yaml; the Debian package and the image have it. TOML and JSON need none"
)


class _Device(NamedTuple):
    """One of its devices, as its file has it."""

    where: str
    url: SplitResult
    bind: SplitResult
    timeout: float
    connection_time: float
    #: Units of the clients, and what the device knows them as.
    remapped: dict[int, int]

    @property
    def protocol(self) -> str:
        """What is spoken to the device, and to its clients."""
        _, plus, protocol = self.url.scheme.rpartition("+")
        return protocol if plus else "tcp" if self.url.scheme == "tcp" else "rtu"

    @property
    def is_serial(self) -> bool:
        return self.url.scheme.partition("+")[0] == "serial"


class _Unit(NamedTuple):
    """A unit as clients asked for it, as they ask for it now (0: not at all), and as the device knows it."""

    before: int
    now: int
    there: int


def config_from_modbus_proxy(file: str, text: str) -> str:
    """The config that does what modbus-proxy does with this `file`, which has this `text`.

    Raises:
        ImportedFileError: it cannot be understood.
    """
    devices = [_device(one, f"{file}: device {number}") for number, one in enumerate(_devices(file, text), start=1)]
    taken, units = Taken(), _Units(alone=sum(one.protocol == "tcp" for one in devices) == 1)
    tables: list[TableText] = []
    ports: set[str] = set()
    binds = [_bind(device, "tcp") for device in devices]
    for device in devices:
        is_tcp = device.protocol == "tcp"
        tables += _upstream(device, taken, units, binds) if is_tcp else _line(device, taken, ports, binds)
    if not any(table.heading for table in tables):
        raise ImportedFileError(f"{file}: there is no device that the gateway can reach")
    return file_text([TableText("", comments=(f"From modbus-proxy: {file}",)), *tables, OPEN_ACCESS])


def _devices(file: str, text: str) -> list[Any]:
    try:
        document = _parsed(PurePath(file).suffix.lower(), text)
    except (ValueError, RecursionError) as wrong:
        raise ImportedFileError(f"{file}: {wrong}") from None
    devices = document.get("devices") if isinstance(document, dict) else None
    if not isinstance(devices, list) or not devices:
        raise ImportedFileError(f"{file}: there is no list of devices in it")
    return devices


def _parsed(kind: str, text: str) -> Any:
    """The document in a text.

    Raises:
        ValueError: it is none.
    """
    if kind == ".toml":
        return tomllib.loads(text)
    if kind == ".json":
        return json.loads(text)
    try:
        from ruamel.yaml import YAML  # noqa: PLC0415 - an extra
        from ruamel.yaml.error import YAMLError  # noqa: PLC0415
    except ImportError:
        raise ImportedFileError(_NO_LIBRARY) from None
    try:
        return YAML(typ="safe", pure=True).load(text)
    except YAMLError as wrong:
        raise ValueError(" ".join(str(wrong).split())) from None


def _device(table: Any, where: str) -> _Device:
    modbus, listen = _part(table, "modbus", where), _part(table, "listen", where)
    return _Device(
        where,
        _url(modbus, "url", where),
        _url(listen, "bind", where),
        _seconds(modbus.get("timeout"), _TIMEOUT, f"{where}: timeout"),
        _seconds(modbus.get("connection_time"), 0.0, f"{where}: connection_time"),
        dict(_remapped(table.get("unit_id_remapping") or {}, where)),
    )


def _part(table: Any, key: str, where: str) -> dict[str, Any]:
    part = table.get(key) if isinstance(table, dict) else None
    if not isinstance(part, dict):
        raise ImportedFileError(f"{where}: it has no {key}")
    return part


def _url(table: Mapping[str, Any], key: str, where: str) -> SplitResult:
    value = table.get(key)
    if not isinstance(value, str):
        raise ImportedFileError(f"{where}: it has no {key}")
    try:
        url = urlsplit(value if "://" in value else f"tcp://{value}")
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


def _remapped(table: Any, where: str) -> Iterator[tuple[int, int]]:
    if not isinstance(table, dict):
        raise ImportedFileError(f"{where}: unit_id_remapping must be pairs of units")
    for known_as, unit in table.items():
        numbers = [int(each) if isinstance(each, str) and each.isdecimal() else each for each in (known_as, unit)]
        if not all(isinstance(each, int) and not isinstance(each, bool) and 0 <= each <= 255 for each in numbers):
            raise ImportedFileError(f"{where}: unit_id_remapping: a unit is a number from 0 to 255")
        yield numbers[0], numbers[1]


class _Units:
    """Hands out units for clients: each one leads to one place."""

    def __init__(self, *, alone: bool) -> None:
        self._free = [*range(FIRST_UNIT, LAST_UNIT + 1), SERVER_UNIT]
        self._all = list(self._free) if alone else []

    def take(self, remapped: Mapping[int, int]) -> list[_Unit]:
        """The units of a device. One that is alone has all; of others those are known that the config names, or 1."""
        known = self._all or ([] if remapped else [FIRST_UNIT])
        asked = {**{unit: unit for unit in known}, **remapped}
        found = [_Unit(before, self._take(before), unit) for before, unit in sorted(asked.items(), key=self._wishes)]
        return sorted(found)

    def _take(self, wanted: int) -> int:
        """This unit, or another one; 0 if there is none."""
        now = wanted if wanted in self._free else next((unit for unit in self._free if unit <= LAST_UNIT), 0)
        if now:
            self._free.remove(now)
        return now

    def _wishes(self, pair: tuple[int, int]) -> bool:
        """Those that can have their own number come first."""
        return pair[0] not in self._free


def _upstream(device: _Device, taken: Taken, units: _Units, binds: list[Address]) -> Iterator[TableText]:
    """A Modbus TCP device: another server, and the address at which clients ask for it."""
    bind, to = _bind(device, "tcp"), _to(device, "tcp")
    why = _why_not(bind, to, taken, binds)
    found = [] if why else units.take(device.remapped)
    rows = [one for one in found if one.now]
    if not rows:
        yield left_out(device.where, [why or "all units are those of other devices"])
        return
    yield TableText("[[listen]]", {"bind": str(bind)}, (device.where,))
    keys: dict[str, Value] = {
        "name": taken.name(f"{to.host}-{to.port}"),
        "to": str(to),
        "units": _unit_rows(rows),
        "timeout": _duration(device.timeout),
        "in_flight": 1,
    }
    yield TableText("[[upstream]]", keys, tuple(_remarks(device, bind, found)))


def _why_not(bind: Address, to: Address, taken: Taken, binds: list[Address]) -> str:
    """What keeps a device from being asked; then its address is not taken."""
    if any(each.is_reached_by(to) for each in binds):
        return f"{to} leads back to an address where clients connect"
    return "" if taken.address(bind) else f"another device has {bind} already"


def _remarks(device: _Device, bind: Address, units: list[_Unit]) -> Iterator[str]:
    """What is not as it was."""
    for before, now, _ in units:
        if not now:
            yield f"clients of {bind} cannot ask for unit {before} any more"
        elif before != now:
            yield f"clients of {bind} ask for unit {now} now, which was {before}"
    if len(units) < LAST_UNIT:
        yield "add the other units of the device to `units`, each with a number of its own"
    if device.connection_time:
        yield f"there is no pause of {device.connection_time:g} s after connecting here"


def _unit_rows(units: list[_Unit]) -> list[Value]:
    """Units that keep their numbers in one row, and each other one in a row of its own."""
    same = [one.now for one in units if one.now == one.there]
    rows: list[Value] = [{"as": _units(same), "unit": _units(same)}] if same else []
    return rows + [{"as": one.now, "unit": one.there} for one in units if one.now != one.there]


def _units(units: list[int]) -> Value:
    runs: list[Value] = [int(run) if run.isdecimal() else run for run in show_units(units).split(", ")]
    return runs[0] if len(runs) == 1 else runs


def _line(device: _Device, taken: Taken, ports: set[str], binds: list[Address]) -> Iterator[TableText]:
    """A device that is reached by RTU: clients speak RTU over TCP with it too."""
    bind = _bind(device, "rtu+tcp")
    keys = _serial(device) if device.is_serial else _device_server(device)
    if keys is None:
        yield left_out(device.where, [f"{device.url.scheme}:// is not known here"])
        return
    port = str(keys["port"])
    why = f"another device has {port} already" if port in ports else ""
    if not device.is_serial:
        why = why or _why_not(bind, _to(device, "rtu+tcp"), taken, binds)
    elif not why and not taken.address(bind):
        why = f"another device has {bind} already"
    if why:
        yield left_out(device.where, [why])
        return
    ports.add(port)
    name = taken.name(port.rsplit("/", 1)[-1])
    remapped = ["unit_id_remapping is not possible on a listener for one line"] if device.remapped else []
    yield TableText("[[listen]]", {"name": name, "bind": str(bind), "line": name}, (device.where, *remapped))
    yield TableText("[[line]]", {"name": name, **keys, "timeout": _duration(device.timeout)})


def _serial(device: _Device) -> dict[str, Value] | None:
    """The keys of a line on a serial port."""
    options = {key: values[-1] for key, values in parse_qs(device.url.query).items()}
    baud, letters = options.get("baudrate", "9600"), options.get("parity", "N")[:1].upper()
    format_ = f"{options.get('bytesize', '8')}{letters}{options.get('stopbits', '1')}"
    try:
        is_usable = fits_mode(parse_format(format_), "rtu") and baud.isdecimal() and 0 < int(baud) <= 100_000_000
        is_usable = is_usable and isinstance(parse_port(device.url.path), str)
    except WrongValue as wrong:
        raise ImportedFileError(f"{device.where}: url: {wrong}") from None
    if not is_usable:
        raise ImportedFileError(f"{device.where}: url: its settings are not those of an RTU line")
    return {"port": device.url.path, "baud": int(baud), "format": format_}


def _device_server(device: _Device) -> dict[str, Value] | None:
    """The keys of a line behind a device server; None for what is no RTU over TCP."""
    if device.url.scheme != "tcp+rtu":
        return None
    return {"port": str(_to(device, "rtu+tcp"))}


def _bind(device: _Device, scheme: str) -> Address:
    host, port = device.bind.hostname or "", device.bind.port
    return listen_address(scheme, host, 502 if port is None else port, f"{device.where}: bind")


def _to(device: _Device, scheme: str) -> Address:
    host = device.url.hostname or "0"
    port = 502 if device.url.port is None else device.url.port
    found = address(scheme, "127.0.0.1" if host == "0" else host, port, f"{device.where}: url")
    if found.is_wildcard or not found.port:
        raise ImportedFileError(f"{device.where}: url: {found} is not the address of a device")
    return found


def _duration(seconds: float) -> str:
    return milliseconds(1000 * max(seconds, 0.001))
