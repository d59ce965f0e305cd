"""The latest values as CSV."""

import pytest

from gateway.modbus.codes import Area
from gateway.operator.operations.answers.known_values import KnownValue
from gateway.operator.values.values_csv import values_as_csv


def told(value: int | str) -> KnownValue:
    return KnownValue(
        unit=1,
        name="meter",
        point="title",
        area=Area.HOLDING,
        address=0,
        reference="40001",
        value=value,
        text=str(value),
        registers=(),
        state="fresh",
        age_ms=1500.0,
        time="2026-05-01T12:00:00Z",
        source="panel",
        stale_ms=60_000.0,
    )


@pytest.mark.parametrize(
    ("value", "cell"),
    [("=cmd|'/C calc'!A1", "'=cmd|'/C calc'!A1"), ("@SUM(1)", "'@SUM(1)"), ("a=b", "a=b"), (-5, "-5")],
)
def test_text_of_a_device_is_no_formula(value, cell) -> None:
    row = values_as_csv([told(value)]).splitlines()[1]
    assert row == f"meter,title,{cell},,fresh,1.5,panel,2026-05-01T12:00:00Z"
