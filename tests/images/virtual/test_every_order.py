"""Every order of what may happen to a virtual unit of two devices, up to a length: nothing may go wrong."""

from collections.abc import Callable
from itertools import product

import pytest

from images.virtual.model import SIZE, Model, Row

ROWS = (
    Row(0, "a", 0, write=True, when_stale="hold"),
    Row(SIZE, "b", 0, write=True),
    Row(2 * SIZE, "a", 1, swap="words", when_stale=7),
)
OTHER_ROWS = (ROWS[0], Row(SIZE, "b", 1), Row(2 * SIZE, "a", 0, swap="words", when_stale=7))


def _later(model: Model) -> None:
    model.time_passes(1.1)


def _answers(name: str, which: int, failure: int | None = None) -> Callable[[Model], None]:
    def answer(model: Model) -> None:
        if which < len(model.bench[name].asked):
            model.registers[name] = [word + 1 for word in model.registers[name]]
            model.answer(name, which, failure)

    return answer


def _reads(client: str, first: int, count: int) -> Callable[[Model], None]:
    def read(model: Model) -> None:
        if client not in model.open:
            model.read(client, first, count)
            model.read_bits_and_ages("third")

    return read


def _writes(client: str, at: int) -> Callable[[Model], None]:
    def write(model: Model) -> None:
        row = model.rows[at]
        if client not in model.open and row.write:
            model.write(client, row, 0, [1000 + len(model.open), 1001])

    return write


def _reloads(model: Model) -> None:
    if not model.open:
        model.reload(OTHER_ROWS if model.rows is ROWS else ROWS)


LETTERS = {
    "later": _later,
    "a answers": _answers("a", 0),
    "a answers the second": _answers("a", 1),
    "a fails": _answers("a", 0, 11),
    "b answers": _answers("b", 0),
    "b fails": _answers("b", 0, 4),
    "one reads all": _reads("one", 0, 3 * SIZE),
    "other reads a": _reads("other", 1, 2),
    "one writes to a": _writes("one", 0),
    "other writes to b": _writes("other", 1),
    "reload": _reloads,
}


def _play(*letters: str) -> None:
    model = Model(("a", "b"), ROWS)
    model.clients["third"] = model.bench.client("third")
    for letter in letters:
        LETTERS[letter](model)
    for _ in range(4):
        model.time_passes(1.1)
        model.fail_everything()
    assert not model.open


@pytest.mark.parametrize("first", LETTERS)
def test_every_order(first):
    for others in product(LETTERS, repeat=2):
        _play("a answers", "b answers", first, *others)


@pytest.mark.search
@pytest.mark.parametrize("first", LETTERS)
def test_every_longer_order(first):
    for others in product(LETTERS, repeat=3):
        _play(first, *others)
        _play("a answers", "b answers", first, *others)
