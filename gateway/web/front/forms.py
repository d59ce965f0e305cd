"""The fields of a form whose body may be long: read in slices of little work, for a thread."""

from collections.abc import Iterator
from typing import Final
from urllib.parse import unquote_to_bytes

from gateway.clock.slices import with_rests

#: The most fields of a form.
MOST_FIELDS: Final = 64
#: So many bytes are read at once.
_PIECE: Final = 2048


def read_form(body: bytes) -> dict[str, str]:
    """Read the fields of a form by their names.

    Raises:
        ValueError: it has more than MOST_FIELDS, or is not UTF-8.
    """
    if body.count(b"&") >= MOST_FIELDS:
        raise ValueError(f"more than {MOST_FIELDS} fields")
    pairs = (field.partition(b"=") for field in body.split(b"&"))
    return {_read(name): _read(value) for name, _, value in pairs if name}


def _read(written: bytes) -> str:
    return b"".join(with_rests(_pieces(written))).decode()


def _pieces(written: bytes) -> Iterator[bytes]:
    """Yield what is written, piece by piece; no escape is cut."""
    at = 0
    while at < len(written):
        end = at + _PIECE
        cut = written.rfind(b"%", end - 2, end)
        end = cut if cut > at and end < len(written) else end
        yield unquote_to_bytes(written[at:end].replace(b"+", b" "))
        at = end
