"""Files of Home Assistant: YAML with tags of its own, and the keys of its tables.

`!include` is followed to files below the folder of the first one, `!secret` to `secrets.yaml` there, when they are
needed. Any other tag is a value that is not known here. Which keys were read is remembered: the others can be told.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from pathlib import PurePosixPath
from typing import Any, Final

from gateway.config.importing.imported import ImportedFileError
from gateway.config.importing.yaml_text import Table, Tagged, parse_located_yaml, plain_text

_TRUE: Final = frozenset(("true", "yes", "on", "1"))
_LARGEST_EXPONENT: Final = 300
_SECRETS: Final = "secrets.yaml"
_MOST_FILES: Final = 100


@dataclass(slots=True)
class Documents:
    """The files of a config: `read` returns the text of one, by its path."""

    file: str
    read: Callable[[str], str]
    _loaded: dict[str, Any] = field(default_factory=dict)

    def document(self) -> Any:
        """Parse the first file."""
        return self._load(self.file)

    def follow(self, value: Any) -> Any:
        """Return the value itself, or what its tag leads to."""
        for _ in range(_MOST_FILES):
            if not isinstance(value, Tagged):
                return value
            value = self._followed(value)
        raise ImportedFileError("it includes itself")

    def _followed(self, tagged: Tagged) -> Any:
        name = plain_text(tagged.value)
        if not name:
            raise ImportedFileError(f"{tagged.tag} names nothing")
        if tagged.tag == "!include":
            path = PurePosixPath(name)
            if path.is_absolute() or ".." in path.parts:
                raise ImportedFileError(f"!include {name} is not below the folder of the file: import that file itself")
            return self._load(self._beside(name))
        if tagged.tag == "!secret":
            secrets = self._load(self._beside(_SECRETS))
            if not isinstance(secrets, dict) or name not in secrets:
                raise ImportedFileError(f"!secret {name}: there is no {name} in {_SECRETS}")
            return secrets[name]
        remedy = "import its files one by one" if tagged.tag.startswith("!include") else "write the value itself"
        raise ImportedFileError(f"{tagged.tag} is not known here: {remedy}")

    def _beside(self, name: str) -> str:
        folder, slash, _ = self.file.rpartition("/")
        return f"{folder}{slash}{name}"

    def _load(self, file: str) -> Any:
        if file not in self._loaded:
            if len(self._loaded) >= _MOST_FILES:
                raise ImportedFileError(f"more than {_MOST_FILES} files are included")
            try:
                self._loaded[file] = parse_located_yaml(self.read(file), file.rpartition("/")[2])
            except ValueError as wrong:
                raise ImportedFileError(f"{file}: {wrong}") from None
            except RecursionError:
                raise ImportedFileError(f"{file}: is nested too deeply") from None
        return self._loaded[file]


class Fields:
    """Reads a table, whose tags lead to other `documents`. Each method raises ImportedFileError for a wrong value."""

    def __init__(self, table: Table, documents: Documents) -> None:
        self._table = table
        self._documents = documents
        self._read: set[str] = set()

    @property
    def where(self) -> str:
        """Where the table stands."""
        return self._table.where

    def has(self, key: str) -> bool:
        """Tell whether the table has this key, with or without a value."""
        return key in self._table

    def unread(self, without_meaning: Collection[str]) -> list[str]:
        """List the keys that were not read, but for those that have no meaning here."""
        return [key for key in self._table if key not in self._read and key not in without_meaning]

    def value(self, key: str) -> Any:
        """Return what stands there, whatever it is; None if there is nothing."""
        self._read.add(key)
        try:
            return self._documents.follow(self._table.get(key))
        except ImportedFileError as wrong:
            raise ImportedFileError(f"{key}: {wrong}") from None

    def text(self, key: str, usual: str) -> str:
        """Return a text."""
        value = self.value(key)
        if isinstance(value, (dict, list)):
            raise ImportedFileError(f"{key} must be text")
        return usual if value is None else str(value)

    def truth(self, key: str) -> bool:
        """Return a truth value; false if there is none."""
        return plain_text(self.value(key)).lower() in _TRUE

    def whole(self, key: str, usual: int | None = None) -> int:
        """Return a whole number that is not negative; it must be there if none is usual."""
        value = self.value(key)
        return usual if value is None and usual is not None else whole(value, key)

    def number(self, key: str) -> Decimal | None:
        """Return a number, or None."""
        value = self.value(key)
        if value is None:
            return None
        try:
            number = Decimal(plain_text(value))
        except InvalidOperation:
            number = Decimal("nan")
        if not number.is_finite() or abs(number.adjusted()) > _LARGEST_EXPONENT:
            raise ImportedFileError(f"{key} must be a number")
        return number

    def part(self, key: str) -> "Fields | None":
        """Return the table that stands there, or None."""
        value = self.value(key)
        if value is None:
            return None
        if not isinstance(value, Table):
            raise ImportedFileError(f"{key} must be a table")
        return Fields(value, self._documents)

    def rows(self, key: str) -> list[Any]:
        """Return what is in the list that stands there; something alone is a list too."""
        value = self.value(key)
        return value if isinstance(value, list) else [] if value is None else [value]

    def items(self) -> list[tuple[str, Any]]:
        """List all keys and what stands there."""
        return [(key, self.value(key)) for key in self._table]


def fields_of(value: Any, documents: Documents) -> Fields:
    """Read a table; its tag is followed."""
    table = documents.follow(value)
    if not isinstance(table, Table):
        raise ImportedFileError("this must be a table")
    return Fields(table, documents)


def whole(value: Any, key: str) -> int:
    """Check that a value is a whole number that is not negative; it may be text."""
    if value is None:
        raise ImportedFileError(f"it has no {key}")
    text = plain_text(value)
    if isinstance(value, bool) or not text.isascii() or not text.isdecimal() or len(text) > 20:
        raise ImportedFileError(f"{key} must be a whole number")
    return int(text)
