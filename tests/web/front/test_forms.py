"""Long forms are read piece by piece, and nothing of them is lost between two."""

from urllib.parse import parse_qsl, urlencode

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from gateway.web.front import forms
from gateway.web.front.forms import MOST_FIELDS, read_form


@given(st.dictionaries(st.text(min_size=1, max_size=5), st.text(max_size=40), max_size=5), st.integers(3, 9))
@example({"text": "%%%ü\n+ &=" * 9}, 3)
def test_a_form_is_read_as_it_was_written(form, piece):
    form = {name: value for name, value in form.items() if name.isprintable() and "\ud800" not in name + value}
    body = urlencode(form, errors="replace").encode()
    before, forms._PIECE = forms._PIECE, piece
    try:
        assert read_form(body) == dict(parse_qsl(body.decode(), keep_blank_values=True))
    finally:
        forms._PIECE = before


@pytest.mark.parametrize("body", [b"a=%", b"a=%4", b"a=%zz+", b"&&a=1&", b"a", b"=1"])
def test_what_is_no_form_does_no_harm(body):
    assert set(read_form(body)) <= {"a"}


def test_what_is_not_utf8_or_has_too_many_fields_is_refused():
    with pytest.raises(ValueError, match="utf-8"):
        read_form(b"a=%ff")
    with pytest.raises(ValueError, match="more than 64 fields"):
        read_form(b"&" * MOST_FIELDS)
