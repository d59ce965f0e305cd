"""Amounts of memory."""

import pytest

from gateway.config.problem import WrongValue
from gateway.config.values.duration import parse_size_or_zero, show_size


@pytest.mark.parametrize(
    ("text", "size", "shown"),
    [
        ("4 MiB", 4 * 2**20, "4 MiB"),
        ("64KiB", 2**16, "64 KiB"),
        ("0.5 MiB", 2**19, "512 KiB"),
        ("1 GiB", 2**30, "1 GiB"),
        ("0", 0, "0"),
    ],
)
def test_a_size(text: str, size: int, shown: str) -> None:
    assert parse_size_or_zero(text) == size
    assert show_size(size) == shown


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        (4, 'put it in quotes with a unit: "4 MiB"'),
        ("4", 'a size needs a unit write "4 MiB"'),
        ("4 MB", '"MB" is not a valid unit of size'),
        ("1 KiB", "must be 64 KiB to 1 GiB, or 0 for none"),
        ("2 GiB", "must be 64 KiB to 1 GiB"),
        ("-1 MiB", '"-1 MiB" is not a valid size'),
        (True, "is not a valid size"),
        ([], "is not a valid size"),
    ],
)
def test_what_is_none_is_told(value: object, complaint: str) -> None:
    with pytest.raises(WrongValue) as wrong:
        parse_size_or_zero(value)
    assert complaint in f"{wrong.value} {wrong.value.remedy}"
