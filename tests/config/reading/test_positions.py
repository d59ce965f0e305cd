"""Line and column of every key and value."""

import json
import tomllib
from datetime import date, datetime
from textwrap import dedent

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.reading.positions import Positions

NASTY = dedent(
    r'''
    # a comment with [brackets] and = signs
    site = "plant # no comment" # a comment
    "quoted key".'other' . last = 'a literal \ with "quotes"'
    text = """
    [not.a.table]
    key = "no key" \
      and \""" an escaped end"""""
    literal = \'\'\'
    ['neither']\'\'\'\'
    empty = ""
    when = 1979-05-27 07:32:00Z
    day = 1979-05-27  # a day
    many = [ # opened
      1, [2, 3], "]", # a ] in a comment
      { x = [4], "y z" = { deep.er = 5 } },
    ]

    [plain.table]
    key = 1

    [[line]]
    name = "a"
    devices = [
      { unit = 1 },
      { unit = 2, name = "b" },
    ]
    initial.holding = [{ at = 0 }]

    [line.more]
    key = 2

    [[line]]
    name = "c"

      [[line.inner]]
    key = 3
      [[line.inner]]
    key = 4
    '''
).replace("\\'", "'")


def positions(text):
    tomllib.loads(text)
    return Positions(text)


@pytest.mark.parametrize(
    ("path", "place"),
    [
        (("site",), (3, 8)),
        (("quoted key", "other", "last"), (4, 31)),
        (("text",), (5, 8)),
        (("literal",), (9, 11)),
        (("empty",), (11, 9)),
        (("when",), (12, 8)),
        (("day",), (13, 7)),
        (("many", 0), (15, 3)),
        (("many", 1), (15, 6)),
        (("many", 1, 1), (15, 10)),
        (("many", 2), (15, 14)),
        (("many", 3, "x", 0), (16, 10)),
        (("many", 3, "y z", "deep", "er"), (16, 34)),
        (("plain", "table"), (19, 1)),
        (("plain", "table", "key"), (20, 7)),
        (("line",), (22, 1)),
        (("line", 0), (22, 1)),
        (("line", 0, "devices", 1), (26, 3)),
        (("line", 0, "devices", 1, "name"), (26, 22)),
        (("line", 0, "initial", "holding", 0, "at"), (28, 27)),
        (("line", 0, "more", "key"), (31, 7)),
        (("line", 1), (33, 1)),
        (("line", 1, "inner", 1), (38, 3)),
        (("line", 1, "inner", 1, "key"), (39, 7)),
    ],
)
def test_where_a_value_stands(path, place):
    assert positions(NASTY).value(path) == place


@pytest.mark.parametrize(
    ("path", "place"),
    [
        (("site",), (3, 1)),
        (("quoted key",), (4, 1)),
        (("quoted key", "other", "last"), (4, 24)),
        (("many", 3, "y z", "deep", "er"), (16, 29)),
        (("line", 0, "devices", 1, "name"), (26, 15)),
        (("line", 0, "devices", 1), (26, 3)),
        (("line", 1), (33, 1)),
    ],
)
def test_where_a_key_stands(path, place):
    assert positions(NASTY).key(path) == place


def test_a_key_that_is_missing_stands_where_its_table_does():
    assert positions(NASTY).value(("line", 1, "port")) == (33, 1)
    assert positions(NASTY).value(("line", 0, "devices", 0, "as")) == (25, 3)
    assert positions("").value(("line",)) == (1, 1)


def test_a_value_can_be_had_as_it_is_written():
    assert positions("format = 8E1 # comment").written(("format",)) == "8E1"
    assert positions("x = [8E1, 1]").written(("x", 0)) == "8E1"


KEYS = st.text("ab-\"'.= #\n[]{}", min_size=0, max_size=4)
SCALARS = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.booleans(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text("ab\"'\\#=[]{},\n\t é", max_size=6),
    st.dates(date(1000, 1, 1)),
    st.datetimes(datetime(1000, 1, 1)),  # noqa: DTZ001 - TOML has times without a zone
)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3), max_leaves=6
)
BLANKS = st.sampled_from([" ", "", "\t", "\n", " # ]}\"'\n", "\n\n  "])


def written(draw, value):
    """`value` as TOML, with blanks and comments wherever they may stand."""
    if isinstance(value, dict):
        pairs = [f"{string(draw, key)} = {one_line(value[key])}" for key in value]
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list):
        items = [draw(BLANKS) + written(draw, item) + draw(BLANKS) for item in value]
        return "[" + ",".join(items) + ("\n" if items else "") + "]"
    if isinstance(value, str):
        return string(draw, value, multi_line=True)
    return one_line(value)


def one_line(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)}={one_line(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(one_line, value)) + "]"
    if isinstance(value, datetime):
        return value.isoformat(" ")
    if isinstance(value, date):
        return value.isoformat()
    return json.dumps(value, ensure_ascii=False)


def string(draw, text, *, multi_line=False):
    forms = [json.dumps(text, ensure_ascii=False)]
    if "'" not in text and "\n" not in text:
        forms.append(f"'{text}'")
    if multi_line:
        forms.append('"""' + text.replace("\\", "\\\\").replace('"', '\\"') + '"""')
    if multi_line and "'" not in text:
        forms.append(f"'''\n{text}'''")
    return draw(st.sampled_from(forms))


@st.composite
def documents(draw):
    lines = [draw(BLANKS).strip(" \t") + "\n"]
    for key, value in draw(st.dictionaries(KEYS, VALUES, max_size=4)).items():
        lines.append(f"{string(draw, key)} = {written(draw, value)}{draw(st.sampled_from(['', ' # [x]']))}\n")
    for index in range(draw(st.integers(0, 3))):
        lines.append("[[ rows ]] # [[x]]\n" if draw(st.booleans()) else f"[table.'{index}']\n")
        lines += [f"{string(draw, 'k')} = {written(draw, draw(VALUES))}\n"]
    return "".join(lines)


def leaves(value, path=()):
    if isinstance(value, dict):
        for key, item in value.items():
            yield from leaves(item, (*path, key))
    elif isinstance(value, list):
        for index, item in enumerate(value):
            yield from leaves(item, (*path, index))
    else:
        yield path, value


@given(documents())
def test_each_value_is_found_where_it_is_said_to_stand(text):
    """Whatever is cut out of the text at the place of a value begins with that value."""
    document = tomllib.loads(text)
    found = Positions(text)
    for path, value in leaves(document):
        line, column = found.value(path)
        rest = "\n".join(text.split("\n")[line - 1 :])[column - 1 :]
        assert begins_with(rest, value)
        key_line, key_column = found.key(path)
        assert (key_line, key_column) <= (line, column)


def begins_with(text, value):
    """Whether some beginning of `text` is TOML for `value`."""
    for end in range(1, len(text) + 1):
        try:
            read = tomllib.loads(f"v = {text[:end]}")["v"]
        except tomllib.TOMLDecodeError:
            continue
        if read == value and type(read) is type(value):
            return True
    return False
