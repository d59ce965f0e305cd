"""Answers as JSON in pieces: the same text, and no piece has more than some items of a list."""

import json
from dataclasses import dataclass, field
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.operator.operations.json_text import FEW, has_long_lists, pieces
from gateway.operator.operations.parameters import fields_of

WRITE = partial(json.dumps, default=fields_of, ensure_ascii=False)


@dataclass(frozen=True)
class Unit:
    name: str
    times: tuple[int, ...] = ()
    kinds: dict[int, str] = field(default_factory=dict)
    seen: float | None = field(default=None, metadata={"if_known": True})


@dataclass(frozen=True)
class Status:
    units: tuple[Unit, ...]
    at: float = 0.0


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3),
    lambda inner: (
        st.lists(inner, max_size=2 * FEW)
        | st.dictionaries(st.text(max_size=3), inner, max_size=5)
        | st.builds(
            Unit, st.text(max_size=3), st.tuples(inner), st.dictionaries(st.integers(0, 9), st.text(max_size=2))
        )
    ),
    max_leaves=60,
)


@given(values)
def test_the_text_is_that_of_json(value: object) -> None:
    assert "".join(pieces(value, WRITE)) == WRITE(value)


def test_no_piece_has_more_than_some_items() -> None:
    answer = {"ok": True, "status": Status(tuple(Unit(f"unit-{n}", tuple(range(n))) for n in range(200)))}
    written = [*pieces(answer, WRITE)]
    assert "".join(written) == WRITE(answer)
    assert max(map(len, written)) < 100 * FEW


@pytest.mark.parametrize("empty", [{}, [], (), Status(())])
def test_what_is_empty(empty: object) -> None:
    assert "".join(pieces(empty, WRITE)) == WRITE(empty)


@pytest.mark.parametrize(
    ("answer", "is_long"),
    [
        ([0] * FEW, False),
        ([0] * (FEW + 1), True),
        ({"ok": True, "status": Status((Unit("a"),))}, False),
        ({"ok": True, "status": Status((Unit("a"),) * 100)}, True),
        ({"text": "x" * 10_000}, True),
        ({"a": {"b": {"c": [0] * 100}}}, False),
    ],
)
def test_an_answer_is_long_if_a_list_or_text_near_its_top_is(answer, is_long):
    assert has_long_lists(answer) is is_long
