"""A config out of those of mbusd, one file for each serial port: a line and a listener for each.

Its format and its defaults are those of its manual page, mbusd(8), and of its sample file.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from gateway.config.importing.imported import (
    Imported,
    ImportedFileError,
    Taken,
    gather,
    listen_address,
    milliseconds,
    read_file,
)
from gateway.config.problem import WrongValue
from gateway.config.reading.toml_text import TableText, Value
from gateway.config.values.address import Address
from gateway.config.values.port import fits_mode, parse_format, parse_port

_DEFAULTS: Final[Mapping[str, str]] = {
    "device": "/dev/ttyS0",
    "speed": "19200",
    "mode": "8N1",
    "trx_control": "addc",
    "address": "0.0.0.0",  # noqa: S104 - what mbusd does
    "port": "502",
    "maxconn": "32",
    "timeout": "60",
    "retries": "3",
    "pause": "100",
    "wait": "500",
    "replyonbroadcast": "no",
    "enable_rs485": "no",
    "local_echo": "no",
}
#: What has a meaning for mbusd only.
_WITHOUT_MEANING: Final = frozenset({"loglevel", "logfile", "trx_sysfile"})

#: The least and the most of each number, and what it counts.
_NUMBERS: Final[Mapping[str, tuple[int, int]]] = {
    "speed": (1, 100_000_000),
    "port": (1, 65535),
    "maxconn": (1, 128),
    "timeout": (0, 100_000),
    "retries": (0, 15),
    "pause": (0, 10_000),
    "wait": (1, 10_000),
}

_RTS: Final = "mbusd switched the direction with RTS; here the driver does it, if it can: see the log for line_up"
_INVERTED: Final = "RTS was low while sending: set that in the driver (device tree: rs485-rts-active-low)"
_USB: Final = (
    "mbusd switched the direction of this USB adapter; nearly all of them do it themselves. "
    'If this one does not, and its driver can: rs485 = "kernel"'
)
_SYSFS: Final = "mbusd switched the direction with a GPIO in sysfs, which the gateway cannot: let the driver do it"
_REPEATS: Final = "mbusd repeated writes too; here only reads are sent again"
_PAUSE: Final = 'mbusd paused so long; gap = "auto" is enough for most devices, and faster'

#: A comment behind a value.
_COMMENT = re.compile(r"(?:^|\s)#.*")


class _Setting(NamedTuple):
    """A value, and where it stands."""

    value: str
    where: str


class _Settings:
    """Those of one file."""

    def __init__(self, text: str, file: str) -> None:
        self.file = file
        self.unknown: list[str] = []
        self._settings = {key: _Setting(value, file) for key, value in _DEFAULTS.items()}
        for number, line in enumerate(text.splitlines(), start=1):
            self._read(_COMMENT.sub("", line).strip(), f"{file}:{number}")

    def _read(self, line: str, where: str) -> None:
        if not line:
            return
        key, separator, value = (part.strip() for part in line.partition("="))
        if not separator:
            raise ImportedFileError(f"{where}: this is not a line of an mbusd config: it has no =")
        if key in self._settings:
            self._settings[key] = _Setting(value, where)
        elif key not in _WITHOUT_MEANING:
            self.unknown.append(f"{key} = {value}")

    def text(self, key: str) -> str:
        return self._settings[key].value

    def where(self, key: str) -> str:
        return self._settings[key].where

    def number(self, key: str) -> int:
        setting, (least, most) = self._settings[key], _NUMBERS[key]
        if not setting.value.isdecimal() or not least <= int(setting.value) <= most:
            raise ImportedFileError(f"{setting.where}: {key} must be a number from {least} to {most}")
        return int(setting.value)

    def is_on(self, key: str) -> bool:
        return self.text(key).lower() in ("yes", "y", "on", "true", "1")


def config_from_mbusd(files: Sequence[str], read: Callable[[str], str] = read_file) -> Imported:
    """Write the config that does what mbusd does with these `files`."""
    taken = Taken()
    return gather((f"From mbusd: {', '.join(files)}",), (_tables(file, read, taken) for file in files))


def _tables(file: str, read: Callable[[str], str], taken: Taken) -> Iterator[TableText]:
    """Make a listener and its line."""
    settings = _Settings(read(file), file)
    device, bind = _port(settings), _bind(settings)
    name = taken.name(device.rsplit("/", 1)[-1])
    listen, line = _listener(settings, name, bind), _line(settings, name, device)
    taken.take(bind, device, file)
    yield listen
    yield line


def _listener(settings: _Settings, name: str, bind: Address) -> TableText:
    idle = settings.number("timeout")
    listen: dict[str, Value] = {
        "name": name,
        "bind": str(bind),
        "line": name,
        "clients": settings.number("maxconn"),
        "idle": f"{idle} s" if idle else "0",
        "unit0": "broadcast",
    }
    said = ["mbusd answered broadcasts; the gateway does not"] if settings.is_on("replyonbroadcast") else []
    return TableText("[[listen]]", listen, (settings.file, *said))


def _line(settings: _Settings, name: str, device: str) -> TableText:
    retries, pause = settings.number("retries"), settings.number("pause")
    keys: dict[str, Value] = {
        "name": name,
        "port": device,
        "baud": settings.number("speed"),
        "format": _format(settings),
        "timeout": milliseconds(settings.number("wait")),
        "gap": milliseconds(pause) if pause else "auto",
        "retries": retries,
    }
    comments = [f"mbusd had {one}, which is not known here" for one in settings.unknown]
    comments += [_REPEATS] if retries else []
    comments += [_PAUSE] if pause else []
    if settings.is_on("local_echo"):
        keys["echo"] = True
    control = settings.text("trx_control").lower()
    is_by_rts = control.startswith("rts")
    if control.startswith("sysfs"):
        comments.append(_SYSFS)
    elif (is_by_rts or settings.is_on("enable_rs485")) and _is_usb(device):
        comments.append(_USB)
    elif is_by_rts or settings.is_on("enable_rs485"):
        keys["rs485"] = "kernel"
        comments += [_RTS] if is_by_rts else []
        comments += [_INVERTED] if control == "rts_0" else []
    return TableText("[[line]]", keys, tuple(comments))


def _is_usb(device: str) -> bool:
    """Tell whether a port is named like those of USB adapters: few of their drivers have RS-485."""
    return "usb" in device.lower() or "/ttyACM" in device


def _port(settings: _Settings) -> str:
    device = settings.text("device")
    try:
        if "://" not in device and parse_port(device):
            return device
    except WrongValue as wrong:
        raise ImportedFileError(f"{settings.where('device')}: {wrong}") from None
    raise ImportedFileError(f"{settings.where('device')}: {device} is not a serial port")


def _bind(settings: _Settings) -> Address:
    return listen_address("tcp", settings.text("address"), settings.number("port"), settings.where("address"))


def _format(settings: _Settings) -> str:
    wanted = settings.text("mode").upper()
    try:
        if fits_mode(parse_format(wanted), "rtu"):
            return wanted
    except WrongValue:
        pass
    raise ImportedFileError(f"{settings.where('mode')}: mode must be one such as 8N1")
