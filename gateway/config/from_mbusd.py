"""A config out of those of mbusd, one file for each serial port: a line and a listener for each.

Its format and its defaults are those of its manual page, mbusd(8), and of its sample file.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.config.address import Address
from gateway.config.character_format import fits_mode, parse_format
from gateway.config.imported import (
    OPEN_ACCESS,
    ImportedFileError,
    Taken,
    left_out,
    listen_address,
    milliseconds,
)
from gateway.config.port import parse_port
from gateway.config.problem import WrongValue
from gateway.config.toml_text import TableText, Value, file_text

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
_SYSFS: Final = "mbusd switched the direction with a GPIO in sysfs, which the gateway cannot: let the driver do it"
_REPEATS: Final = "mbusd repeated writes too; here only reads are sent again"
_PAUSE: Final = 'mbusd paused so long; gap = "auto" is enough for most devices, and faster'


@dataclass(frozen=True, slots=True)
class _Setting:
    """A value, and where it stands: empty for a default."""

    value: str
    where: str


class _Settings:
    """Those of one file."""

    def __init__(self, text: str, file: str) -> None:
        self.file = file
        self.unknown: list[str] = []
        self._settings = {key: _Setting(value, file) for key, value in _DEFAULTS.items()}
        for number, line in enumerate(text.splitlines(), start=1):
            self._read(line.strip(), f"{file}:{number}")

    def _read(self, line: str, where: str) -> None:
        if not line or line.startswith("#"):
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


def config_from_mbusd(files: Mapping[str, str]) -> str:
    """The config that does what mbusd does with these `files` (their texts, by name).

    Raises:
        ImportedFileError: one of them cannot be understood.
    """
    tables: list[TableText] = []
    taken, ports = Taken(), dict[str, str]()
    for file, text in files.items():
        tables += _line(_Settings(text, file), taken, ports)
    return file_text([TableText("", comments=(f"From mbusd: {', '.join(files)}",)), *tables, OPEN_ACCESS])


def read_files(paths: list[str]) -> dict[str, str]:
    """The texts of files.

    Raises:
        ImportedFileError: one of them cannot be read.
    """
    texts = {}
    for path in paths:
        try:
            texts[path] = Path(path).read_text(encoding="utf-8-sig")
        except OSError as error:
            raise ImportedFileError(f"{path}: {error.strerror}") from None
        except UnicodeDecodeError:
            raise ImportedFileError(f"{path}: is not text in UTF-8") from None
    return texts


def _line(settings: _Settings, taken: Taken, ports: dict[str, str]) -> Iterator[TableText]:
    """A listener and its line."""
    device, bind = _port(settings), _bind(settings)
    if device in ports:
        yield left_out(settings.file, [f"{device} is the port of {ports[device]} too, and a port belongs to one line"])
        return
    if not taken.address(bind):
        yield left_out(settings.file, [f"another listener has {bind} already"])
        return
    ports[device] = settings.file
    name = taken.name(device.rsplit("/", 1)[-1])
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
    yield TableText("[[listen]]", listen, (settings.file, *said))
    yield _client_line(settings, name, device)


def _client_line(settings: _Settings, name: str, device: str) -> TableText:
    retries, pause = settings.number("retries"), settings.number("pause")
    comments = [f"mbusd had {one}, which is not known here" for one in settings.unknown]
    rs485 = list(_rs485(settings))
    comments += rs485
    comments += [_REPEATS] if retries else []
    comments += [_PAUSE] if pause else []
    keys: dict[str, Value] = {
        "name": name,
        "port": device,
        "baud": settings.number("speed"),
        "format": _format(settings),
        "timeout": milliseconds(settings.number("wait")),
        "gap": milliseconds(pause) if pause else "auto",
        "retries": retries,
    }
    if settings.is_on("enable_rs485") or settings.text("trx_control").lower().startswith("rts"):
        keys["rs485"] = "kernel"
    return TableText("[[line]]", keys, tuple(comments))


def _rs485(settings: _Settings) -> Iterator[str]:
    """What is to be said of the direction control."""
    control = settings.text("trx_control").lower()
    if control.startswith("rts"):
        yield _RTS
    if control == "rts_0":
        yield _INVERTED
    if control.startswith("sysfs"):
        yield _SYSFS


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
