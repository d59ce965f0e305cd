"""Recognises the kind of a unit by reads that change nothing: what is asked, and which kinds fit the answers.

First its identification (function 43/14), then its SunSpec models, then registers: it ends with what tells the kind.
"""

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from gateway.modbus.codes import EXCEPTION_BIT
from gateway.modbus.functions import READING_IDENTIFICATION
from gateway.profiles.identity import Identity
from gateway.profiles.sunspec import Model, Questions, layout_of, read_registers, walk
from gateway.timing.characters import Mode

#: The codes that read the basic objects, and all regular ones from the first that is not basic (A 6.21).
_BASIC: Final = (1, 0)
_REGULAR: Final = (2, 3)
#: The conformity level of devices that have regular objects, and the bits that tell it.
_HAS_REGULAR: Final = 2
_LEVEL: Final = 0x7F
_MORE: Final = 0xFF
#: The most responses with objects, and the most registers, that are asked for.
MOST_RESPONSES: Final = 4
MOST_REGISTERS: Final = 32
#: After so many questions without an answer no other one is asked.
MOST_UNANSWERED: Final = 8


class KnownKind(NamedTuple):
    """A kind of device that can be recognised. `models` are its SunSpec models, where its profile has them."""

    name: str
    identity: Identity
    mode: Mode | None = None
    models: tuple[Model, ...] = ()


class Recognised(NamedTuple):
    """The kinds that fit: none, one, or several that cannot be told apart; and the SunSpec models of the unit."""

    names: tuple[str, ...] = ()
    models: tuple[Model, ...] = ()


def recognise(kinds: Sequence[KnownKind]) -> Questions[Recognised]:
    """Ask what tells the kinds apart, with few questions to a unit that does not answer."""
    return (yield from _patiently(_recognise(kinds)))


def _patiently(steps: Questions[Recognised]) -> Questions[Recognised]:
    unanswered = 0
    try:
        question = next(steps)
        while True:
            answer = (yield question) if unanswered < MOST_UNANSWERED else None
            unanswered += answer is None
            question = steps.send(answer)
    except StopIteration as end:
        found: Recognised = end.value
        return found


def _recognise(kinds: Sequence[KnownKind]) -> Questions[Recognised]:
    names = yield from _by_text(kinds)
    models = (yield from walk()) if kinds and not names else ()
    names = names or _of_models(kinds, models) or (yield from _by_register(kinds))
    return Recognised(names, models)


def _by_text(kinds: Sequence[KnownKind]) -> Questions[tuple[str, ...]]:
    """Ask for the basic objects, and for the regular ones if these tell no kind; the longest text that fits counts."""
    told = [kind for kind in kinds if kind.identity.fc43]
    code, first = _BASIC
    for _ in range(MOST_RESPONSES if told else 0):
        response = yield READING_IDENTIFICATION + bytes((code, first))
        if response is None or response[0] & EXCEPTION_BIT:
            break
        texts = [text.strip(b" \0").decode("utf-8", "replace") for text in _objects(response)]
        fits = [kind for kind in told if any(text.startswith(kind.identity.fc43) for text in texts)]
        if fits:
            longest = max(len(kind.identity.fc43) for kind in fits)
            return tuple(kind.name for kind in fits if len(kind.identity.fc43) == longest)
        level, more, following = response[3:6]
        if more == _MORE and following > first:
            first = following
        elif code == _BASIC[0] and level & _LEVEL >= _HAS_REGULAR:
            code, first = _REGULAR
        else:
            break
    return ()


def _objects(response: bytes) -> Iterator[bytes]:
    """Yield the values of the objects in a response: identifier, length, value of each (A 6.21)."""
    at = 7
    for _ in range(response[6]):
        size = response[at + 1]
        yield response[at + 2 : at + 2 + size]
        at += 2 + size


def _of_models(kinds: Sequence[KnownKind], models: Sequence[Model]) -> tuple[str, ...]:
    """Choose the kinds that have the most models, each, or one with the same registers, at its address."""
    there = _places(models)
    fits = [kind for kind in kinds if kind.models and there.issuperset(_places(kind.models))]
    most = max((len(kind.models) for kind in fits), default=0)
    return tuple(kind.name for kind in fits if len(kind.models) == most)


def _places(models: Sequence[Model]) -> set[tuple[int, int]]:
    return {(layout_of(model.model), model.address) for model in models}


def _by_register(kinds: Sequence[KnownKind]) -> Questions[tuple[str, ...]]:
    """Ask for each register that tells a kind, once."""
    registers = [(kind.name, kind.identity.register) for kind in kinds if kind.identity.register is not None]
    places = dict.fromkeys((register.area, register.address) for _, register in registers)
    values: dict[object, bytes | None] = {}
    for place in list(places)[:MOST_REGISTERS]:
        area, address = place
        values[place] = yield from read_registers(address, 1, area)
    return tuple(
        name for name, (area, address, equals) in registers if values.get((area, address)) == equals.to_bytes(2, "big")
    )
