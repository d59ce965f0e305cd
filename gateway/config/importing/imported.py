"""What configs of other programs have in common on their way into one of ours."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import Final, NamedTuple

from gateway.config.machine.file_text import UnreadableFile, read_file_bytes, read_file_text
from gateway.config.problem import WrongValue
from gateway.config.reading.toml_text import TableText, file_text
from gateway.config.values.address import Address, parse_address
from gateway.config.values.reserved_names import RESERVED
from gateway.errors import GatewayError

#: Others let every client write.
_OPEN_ACCESS: Final = TableText(
    "[[access]]",
    {"allow": ["read", "write"]},
    ("Every client may write, as before. Better: name those who may, such as", 'from = ["10.2.0.0/24"]'),
)


class ImportedFileError(GatewayError):
    """A file, or a part of it, cannot be understood or used. The text says where, and what is wrong."""


class Imported(NamedTuple):
    """A config, and what of the old one is not in it: for each part where it stands, and why.

    `notes` are for who imports it: what was taken for granted.
    """

    text: str
    left_out: tuple[str, ...]
    notes: tuple[str, ...] = ()


def gather(comments: tuple[str, ...], parts: Iterable[Iterator[TableText]]) -> Imported:
    """Write the config of these `parts`, below these comments; a comment in place of a part that cannot be used."""
    tables: list[TableText] = []
    left_out: list[str] = []
    for part in parts:
        try:
            tables += list(part)
        except ImportedFileError as error:
            left_out.append(str(error))
            tables.append(TableText("", comments=(f"Left out: {error}",)))
    if len(left_out) == len(tables):
        raise ImportedFileError("\n".join(left_out))
    return Imported(file_text([TableText("", comments=comments), *tables, _OPEN_ACCESS]), tuple(left_out))


def read_file(path: str) -> str:
    """Read the text of a file."""
    try:
        return read_file_text(Path(path))
    except UnreadableFile as wrong:
        raise ImportedFileError(f"{path}: {wrong}") from None


def read_bytes(path: str) -> bytes:
    """Read a file that may be no UTF-8 text."""
    try:
        return read_file_bytes(Path(path))
    except UnreadableFile as wrong:
        raise ImportedFileError(f"{path}: {wrong}") from None


def take_name(base: str, taken: set[str]) -> str:
    """Take this name, or the first one with a number behind it that is free."""
    numbered = (f"{base}-{number}" for number in count(2))
    name = next(each for each in chain((base,), numbered) if each not in taken)
    taken.add(name)
    return name


class Taken:
    """Names, addresses and ports that are used already."""

    def __init__(self) -> None:
        self._names = set(RESERVED)
        self._binds: list[Address] = []
        self._targets: dict[str | Address, str] = {}

    def name(self, wanted: str) -> str:
        """Find a name like this that is not in use, and take it."""
        readable = "".join(letter for letter in wanted.strip() if letter.isprintable()).strip()[:50] or "line"
        return take_name(readable, self._names)

    def take(self, bind: Address, target: str | Address, where: str) -> None:
        """Take the address where clients connect, and the port or server that it leads to, for what stands `where`."""
        if target in self._targets and not (isinstance(target, Address) and target.scheme == "tcp"):
            raise ImportedFileError(f"{where}: {target} is the port of {self._targets[target]} too")
        # Of port 0 there may be many, but each listener is named by its address.
        if bind in self._binds or any(other.collides_with(bind) for other in self._binds):
            raise ImportedFileError(f"{where}: another listener has {bind} already")
        asked = [one for one in (*self._targets, target) if isinstance(one, Address)]
        for each in (one for one in asked if any(other.is_reached_by(one) for other in (*self._binds, bind))):
            raise ImportedFileError(f"{where}: {each} leads back to an address where clients connect")
        self._binds.append(bind)
        self._targets[target] = where


def listen_address(scheme: str, host: str, port: int, where: str) -> Address:
    """Make the address where clients connect: "", "0" and "*" stand for every IPv4 address."""
    host = "0.0.0.0" if host in ("", "0", "*") else host  # noqa: S104 - as the other program does
    return address(scheme, host, port, where)


def address(scheme: str, host: str, port: int, where: str) -> Address:
    """Make the address of a server."""
    try:
        found = parse_address(str(Address(scheme, host.strip("[]"), port)), (scheme,))
    except WrongValue as wrong:
        raise ImportedFileError(f"{where}: {wrong}") from None
    return replace(found, scheme=scheme)


def milliseconds(number: float) -> str:
    """Write a duration as text."""
    return f"{number:g} ms" if number < 1000 or number % 1000 else f"{number / 1000:g} s"
