"""An answer as JSON, in pieces: none takes longer to write than an item of a list.

Written as a whole, a long answer would keep the interpreter from the lines for tens of milliseconds, in any thread.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from typing import Final

from gateway.operator.operations.parameters import fields_of

#: The most items of a list in one piece.
FEW: Final = 16

#: A text is long from so many characters on.
_MANY: Final = 4096

Write = Callable[[object], str]


def json_text(answer: object, write: Write, paced: Callable[[Iterator[str]], Iterator[str]] = iter) -> bytes:
    """Write an answer as `write` does, in UTF-8; `paced` makes pauses between its pieces."""
    return b"".join([piece.encode() for piece in paced(pieces(answer, write))])


def has_long_lists(answer: object, depth: int = 2) -> bool:
    """Tell whether an answer, or an object up to `depth` deep in it, has a long list or text."""
    if isinstance(answer, str):
        return len(answer) > _MANY
    members = _members(answer) if depth else None
    return _is_long(answer) or any(has_long_lists(each, depth - 1) for each in (members or {}).values())


def pieces(answer: object, write: Write, depth: int = 2) -> Iterator[str]:
    """Write an answer as `write` does, in pieces. Its objects, `depth` of them inside one another, may have long lists.

    So may those on a list. Whatever is deeper is one piece.
    """
    members = _members(answer)
    if members is not None and (depth or any(map(_is_long, members.values()))):
        yield from _joined("{}", (_member(name, each, write, depth - 1) for name, each in members.items()))
    elif isinstance(answer, list | tuple) and len(answer) > FEW:
        chunks = (answer[at : at + FEW] for at in range(0, len(answer), FEW))
        yield from _joined("[]", (_items(each, write) for each in chunks))
    else:
        yield write(answer)


def _members(value: object) -> Mapping[str, object] | None:
    """Return the members of an object by name; None if it is no object, or its names are numbers."""
    members = fields_of(value) if is_dataclass(value) else value
    return members if isinstance(members, dict) and all(isinstance(name, str) for name in members) else None


def _is_long(value: object) -> bool:
    return isinstance(value, list | tuple) and len(value) > FEW


def _items(items: Sequence[object], write: Write) -> Iterator[str]:
    """Write items of a list without its brackets, at once if none of them has a long list."""
    members = map(_members, items)
    if any(_is_long(own) for each in members if each is not None for own in each.values()) or any(map(_is_long, items)):
        yield from _joined(("", ""), (pieces(each, write, 0) for each in items))
    else:
        yield write(items)[1:-1]


def _member(name: str, value: object, write: Write, depth: int) -> Iterator[str]:
    yield f"{write(name)}: "
    yield from pieces(value, write, max(depth, 0))


def _joined(brackets: Sequence[str], parts: Iterator[Iterator[str]]) -> Iterator[str]:
    before = brackets[0]
    for part in parts:
        yield before
        yield from part
        before = ", "
    yield "".join(brackets) if before == brackets[0] else brackets[1]
