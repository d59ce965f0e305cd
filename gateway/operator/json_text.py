"""An answer as JSON, in pieces: none takes longer to write than an item of a list.

Written as a whole, a long answer would keep the interpreter from the lines for tens of milliseconds, in any thread.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from typing import Final

from gateway.operator.parameters import fields_of

#: The most items of a list in one piece.
FEW: Final = 16

Write = Callable[[object], str]


def pieces(answer: object, write: Write, depth: int = 2) -> Iterator[str]:
    """Write an answer as `write` does, in pieces. Its objects, `depth` of them inside one another, may have long lists.

    So may those on a list. Whatever is deeper is one piece.
    """
    members = _members(answer)
    if members is not None and (depth or any(map(_is_long, members.values()))):
        yield from _joined("{}", (_member(name, each, write, depth - 1) for name, each in members.items()))
    elif _is_long(answer):
        yield from _joined("[]", (pieces(each, write, 0) for each in answer))  # type: ignore[attr-defined]
    else:
        yield write(answer)


def _members(value: object) -> Mapping[str, object] | None:
    """Return the members of an object by name; None if it is no object, or its names are numbers."""
    members = fields_of(value) if is_dataclass(value) else value
    return members if isinstance(members, dict) and all(isinstance(name, str) for name in members) else None


def _is_long(value: object) -> bool:
    return isinstance(value, list | tuple) and len(value) > FEW


def _member(name: str, value: object, write: Write, depth: int) -> Iterator[str]:
    yield f"{write(name)}: "
    yield from pieces(value, write, max(depth, 0))


def _joined(brackets: str, parts: Iterator[Iterator[str]]) -> Iterator[str]:
    before = brackets[0]
    for part in parts:
        yield before
        yield from part
        before = ", "
    yield brackets if before == brackets[0] else brackets[1]
