"""The table of operations: what is written there twice, for a quick start, is the same."""

from typing import get_args

import pytest

from gateway.operator.operations import table as operations
from gateway.operator.operations.operation import Operation
from gateway.operator.operations.table import BY_NAME, OPERATIONS


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda each: each.name)
def test_the_type_of_a_result_is_the_one_that_is_loaded(operation):
    constant = operation.name.upper().replace("-", "_")
    assert getattr(operations, constant) is BY_NAME[operation.name] is operation
    parameters, result = get_args(get_args(operations.__annotations__[constant])[0])
    assert parameters is operation.parameters
    assert operation.result
    assert result.__forward_arg__ == operation.result_at.partition(":")[2]
    assert callable(operation.function)


def test_each_operation_that_is_described_is_in_the_table():
    described = {each.name for each in vars(operations).values() if isinstance(each, Operation)}
    assert described == set(BY_NAME) == {each.name for each in OPERATIONS}


def test_over_http_an_operation_has_one_answer():
    assert [each.name for each in OPERATIONS if each.is_repeated and each.path is not None] == []
