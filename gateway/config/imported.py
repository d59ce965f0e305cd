"""What configs of other programs have in common on their way into one of ours."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Final

from gateway.config.address import Address, parse_address
from gateway.config.problem import WrongValue
from gateway.config.toml_text import TableText
from gateway.errors import GatewayError

#: Names that mean something else for [[access]].
_RESERVED: Final = ("control", "mqtt", "web", "fleet")

#: Others let every client write.
OPEN_ACCESS: Final = TableText(
    "[[access]]",
    {"allow": ["read", "write"]},
    ("Every client may write, as before. Better: name those who may, such as", 'from = ["10.2.0.0/24"]'),
)


class ImportedFileError(GatewayError):
    """A file cannot be understood. The text says where, and what is wrong."""


class Taken:
    """Names and addresses that are used already."""

    def __init__(self) -> None:
        self._names = set(_RESERVED)
        self._addresses: list[Address] = []

    def name(self, wanted: str) -> str:
        """A name like this that nobody has."""
        readable = "".join(letter for letter in wanted.strip() if letter.isprintable()).strip()[:50] or "line"
        numbered = (f"{readable}-{number}" for number in range(2, 10_000))
        name = next(each for each in (readable, *numbered) if each not in self._names)
        self._names.add(name)
        return name

    def address(self, address: Address) -> bool:
        """Whether nobody listens there yet; then it is taken."""
        if address in self._addresses or any(other.collides_with(address) for other in self._addresses):
            return False  # of port 0 there may be many, but each listener is named by its address
        self._addresses.append(address)
        return True


def listen_address(scheme: str, host: str, port: int, where: str) -> Address:
    """Where clients connect: "", "0" and "*" stand for every IPv4 address.

    Raises:
        ImportedFileError: it is no address.
    """
    host = "0.0.0.0" if host in ("", "0", "*") else host  # noqa: S104 - as the other program does
    return address(scheme, host, port, where)


def address(scheme: str, host: str, port: int, where: str) -> Address:
    """The address of a server.

    Raises:
        ImportedFileError: it is none.
    """
    try:
        found = parse_address(str(Address(scheme, host.strip("[]"), port)), (scheme,))
    except WrongValue as wrong:
        raise ImportedFileError(f"{where}: {wrong}") from None
    return replace(found, scheme=scheme)


def milliseconds(number: float) -> str:
    """A duration as text."""
    return f"{number:g} ms" if number < 1000 or number % 1000 else f"{number / 1000:g} s"


def left_out(what: str, why: Iterable[str]) -> TableText:
    """Says that a part of the old config has no place in the new one."""
    return TableText("", comments=(f"Left out: {what}", *(f"  {one}" for one in why)))
