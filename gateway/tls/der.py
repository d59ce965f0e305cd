"""A reader of DER (X.690), as far as certificates and revocation lists need it."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

SEQUENCE: Final = 0x30
OBJECT_IDENTIFIER: Final = 0x06
OCTET_STRING: Final = 0x04
INTEGER: Final = 0x02
UTF8_STRING: Final = 0x0C
UTC_TIME: Final = 0x17
GENERALIZED_TIME: Final = 0x18

#: The encodings of text types; others are read as Latin-1.
_ENCODINGS: Final = {UTF8_STRING: "utf-8", 0x1E: "utf-16-be", 0x1C: "utf-32-be"}
_TIME_FORMATS: Final = {UTC_TIME: "%y%m%d%H%M%SZ", GENERALIZED_TIME: "%Y%m%d%H%M%SZ"}


class WrongDer(ValueError):  # noqa: N818 - named after what it is, as in gateway.errors
    """These bytes are not DER, or not what was expected there."""


Element = tuple[int, bytes]


def elements(data: bytes) -> Iterator[Element]:
    """Yield the elements in `data`, each as its tag and its content.

    Raises:
        WrongDer: the bytes are not whole elements of definite length with one-byte tags.
    """
    at = 0
    while at < len(data):
        start, end = _content(data, at)
        yield data[at], data[start:end]
        at = end


def only(data: bytes, tag: int) -> bytes:
    """Return the content of the single element in `data`.

    Raises:
        WrongDer: `data` is not a single element with this tag.
    """
    found = list(elements(data))
    if len(found) != 1 or found[0][0] != tag:
        raise WrongDer(f"is not a single element with tag {tag:#04x}")
    return found[0][1]


def identifier(content: bytes) -> str:
    """Decode an object identifier: `2.5.4.3`.

    Raises:
        WrongDer: it is malformed.
    """
    if not content or content[-1] & 0x80:
        raise WrongDer("is not an object identifier")
    numbers, number = [], 0
    for byte in content:
        number = number << 7 | byte & 0x7F
        if not byte & 0x80:
            numbers.append(number)
            number = 0
    first = min(numbers[0] // 40, 2)
    return ".".join(map(str, (first, numbers[0] - 40 * first, *numbers[1:])))


def text(tag: int, content: bytes) -> str:
    """Decode a string of any type; invalid bytes are replaced."""
    return content.decode(_ENCODINGS.get(tag, "latin-1"), errors="replace")


def time(tag: int, content: bytes) -> float:
    """Decode a time, in seconds since 1970.

    Raises:
        WrongDer: it is not a time (RFC 5280, 4.1.2.5).
    """
    try:
        moment = datetime.strptime(content.decode("ascii"), _TIME_FORMATS[tag]).replace(tzinfo=UTC)
    except (KeyError, ValueError) as wrong:
        raise WrongDer("is not a time") from wrong
    if tag == UTC_TIME and moment.year >= 2050:  # strptime takes 68 for 2068
        moment = moment.replace(year=moment.year - 100)
    return moment.timestamp()


def _content(data: bytes, at: int) -> tuple[int, int]:
    """Return the start and the end of the content of the element at `at`."""
    if at + 2 > len(data) or data[at] & 0x1F == 0x1F:
        raise WrongDer("is cut off, or has a tag of several bytes")
    length, start = data[at + 1], at + 2
    if length & 0x80:
        octets = length & 0x7F
        if not 1 <= octets <= 4 or start + octets > len(data):
            raise WrongDer("has no definite length")
        length, start = int.from_bytes(data[start : start + octets]), start + octets
    if start + length > len(data):
        raise WrongDer("is cut off")
    return start, start + length
