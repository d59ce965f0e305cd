"""The place of a table in a config, and of the keys in it."""

from collections.abc import Mapping


class Source(str):
    """The place of a table, such as `gateway.toml:31`. `lines` are those of its keys that stand in others."""

    __slots__ = ("lines",)

    lines: Mapping[str, int]

    @classmethod
    def of(cls, file: str, line: int, lines: Mapping[str, int]) -> str:
        """Make the place of a table; plain text if all its keys stand in its own line."""
        text = f"{file}:{line}"
        elsewhere = {key: number for key, number in lines.items() if number != line}
        if not elsewhere:
            return text
        source = cls(text)
        source.lines = elsewhere
        return source


def place_of(source: str, key: str) -> str:
    """Find where a key of the table at `source` stands; the place of the table if it is not there, or not known."""
    line = source.lines.get(key) if isinstance(source, Source) else None
    return source if line is None else f"{source.rpartition(':')[0]}:{line}"


def to_write(source: str, keys: Mapping[str, str]) -> str:
    """Say for each of these keys which line of the config is to be changed, and what is to be written there."""
    of_place: dict[str, list[str]] = {}
    for key, value in keys.items():
        of_place.setdefault(place_of(source, key), []).append(f"{key} = {value}")
    return "; ".join(f"{place}: {' and '.join(written)}" for place, written in of_place.items())
