"""What is asked, in words: they say which values there are."""

import pytest

from gateway.errors import Malformed
from gateway.operator.operations.asked import Addresses
from gateway.operator.operations.parameters import parameters_of, read_parameters
from gateway.operator.operations.table import OPERATIONS
from gateway.registers.datatypes import DATA_TYPES


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (
            {"type": "int33"},
            f'"type" must be one of {", ".join(DATA_TYPES)}; without it uint16, for bits bit',
        ),
        ({"swap": "sideways"}, '"swap" must be one of none, words, bytes, both; without it none'),
    ],
)
def test_a_wrong_choice_is_refused_with_the_choices(wrong, said):
    with pytest.raises(Malformed) as refused:
        read_parameters(Addresses, {"unit": 1, "area": "holding", "start": 0, **wrong})
    assert str(refused.value) == said


def test_each_parameter_has_words_of_its_own():
    bare = {"a number", "text", "true or false", "null"}
    told = [(each.name, parameter) for each in OPERATIONS for parameter in parameters_of(each.parameters)]
    assert [(name, each.name, each.what) for name, each in told if set(each.what.split(" or ")) <= bare] == []
