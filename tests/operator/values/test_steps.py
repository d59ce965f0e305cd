"""The requests that read and write values of points, one after the other, without anything that sends them."""

import pytest

from gateway.errors import DoesNotFit, UnitFailed
from gateway.modbus.codes import Area
from gateway.operator.values.steps import Answer, NewValues, Outcome, Steps, reading, writing
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.read_rules import ReadRules

POWER = Point("power", Area.HOLDING, 10, "int16", unit="W", scale_at=13, write="yes")
ALARM = Point("alarm", Area.HOLDING, 8, bits=(3, 3), write="yes")
MODE = Point("mode", Area.HOLDING, 8, bits=(4, 6), write="yes", labels={2: "eco"})
LEVEL = Point("level", Area.INPUT, 12, "int16", scale=0.1, invalid=(-32768,), write="yes", write_at=120)
COUNT = Point("count", Area.HOLDING, 20, "uint32", count=2, write="yes", minimum=10, maximum=20)


def played(steps: Steps, conversation: str) -> Outcome:
    """The outcome of steps that ask exactly this: `>> request`, in one turn if `>>>`, and `<< response`."""
    lines = [line.split(None, 1) for line in conversation.strip().splitlines()]
    asked: list[str] = []
    try:
        step = next(steps)
        while lines:
            asked.append(f"{'>>>' if step.in_one_turn else '>>'} {step.pdu.hex(' ').upper()}")
            (way, request), (_, response) = lines.pop(0), lines.pop(0)
            assert asked[-1] == f"{way} {request}"
            step = steps.send(Answer(bytes.fromhex(response), 1.0))
    except StopIteration as end:
        assert not lines
        return end.value
    raise AssertionError(f"one more request: {step}")


def new(point: Point, text: str, functions: frozenset[int] | None = None) -> NewValues:
    return NewValues([point], [text], {}, functions)


def told(outcome: Outcome) -> list[tuple[object, object]]:
    return [(each.value, each.registers) for each in outcome.readings]


def test_points_of_one_register_are_read_with_one_request():
    outcome = played(reading([ALARM, MODE], ReadRules(), Holes()), ">> 03 00 08 00 01\n<< 03 02 00 28")
    assert told(outcome) == [(1, [0x28]), ("eco", [0x28])]


def test_a_point_is_read_with_its_scale():
    outcome = played(reading([POWER], ReadRules(), Holes()), ">> 03 00 0A 00 04\n<< 03 08 04 D2 00 00 00 00 FF FE")
    assert told(outcome) == [(12.34, [1234])]


def test_a_point_that_is_read_alone_after_a_refusal_is_read_with_its_scale():
    other = Point("other", Area.HOLDING, 14)
    outcome = played(
        reading([POWER, other], ReadRules(), Holes()),
        """
        >> 03 00 0A 00 05
        << 83 02
        >> 03 00 0A 00 04
        << 03 08 04 D2 00 00 00 00 00 00
        >> 03 00 0E 00 01
        << 83 02
        """,
    )
    assert told(outcome) == [(1234, [1234])]


def test_a_point_without_a_value_has_none_and_its_registers():
    outcome = played(reading([LEVEL], ReadRules(), Holes()), ">> 04 00 0C 00 01\n<< 04 02 80 00")
    (found,) = outcome.readings
    assert (found.value, found.text, found.registers) == (None, "–", [0x8000])  # noqa: RUF001
    assert found.as_json(with_area=False)["value"] is None


def test_a_scale_is_read_before_its_value_is_written():
    outcome = played(
        writing(new(POWER, "12.5")),
        """
        >> 03 00 0A 00 04
        << 03 08 00 00 00 00 00 00 FF FF
        >> 06 00 0A 00 7D
        << 06 00 0A 00 7D
        """,
    )
    assert told(outcome) == [(12.5, [125])]


def test_without_a_scale_nothing_is_written():
    steps = writing(new(POWER, "12.5"))
    with pytest.raises(DoesNotFit, match="the device has no scale for power now"):
        played(steps, ">> 03 00 0A 00 04\n<< 03 08 00 00 00 00 00 00 80 00")


def test_a_scale_that_cannot_be_read_is_a_failure_and_nothing_is_written():
    outcome = played(writing(new(POWER, "12.5")), ">> 03 00 0A 00 04\n<< 83 0B")
    assert outcome.readings == []
    assert [(each.answer.exception, each.function) for each in outcome.failures] == [(0x0B, 0)]


def test_a_value_that_no_request_can_write_is_refused_before_the_first_step():
    with pytest.raises(DoesNotFit, match="21 is too high: count must be"):
        writing(new(COUNT, "21"))


def test_bits_are_one_request_of_function_22_where_the_device_knows_it():
    outcome = played(writing(new(MODE, "eco", frozenset({3, 22}))), ">> 16 00 08 FF 8F 00 20\n<< 16 00 08 FF 8F 00 20")
    assert told(outcome) == [("eco", [])]
    assert outcome.readings[0].as_json(with_area=True)["bits"] == (4, 6)


def test_bits_are_one_turn_where_the_device_may_not_know_it():
    outcome = played(writing(new(ALARM, "on")), ">>> 16 00 08 FF F7 00 08\n<< 16 00 08 FF F7 00 08")
    assert told(outcome) == [(1, [])]


@pytest.mark.parametrize(
    ("functions", "request_pdu", "response"),
    [(None, "06 00 08 A5 7F", "06 00 08 A5 7F"), ({3, 16}, "10 00 08 00 01 02 A5 7F", "10 00 08 00 01")],
)
def test_without_a_gateway_they_are_a_read_and_a_write(functions, request_pdu, response):
    at = Point("p", Area.HOLDING, 8, bits=(0, 3), write="yes")
    outcome = played(
        writing(new(at, "15", functions), has_turns=False),
        f"""
        >> 03 00 08 00 01
        << 03 02 A5 70
        >> {request_pdu}
        << {response}
        """,
    )
    assert told(outcome) == [(15, [])]
    assert len(outcome.answers) == 2


def test_without_a_gateway_nothing_is_written_after_a_read_that_failed():
    outcome = played(writing(new(ALARM, "on"), has_turns=False), ">> 03 00 08 00 01\n<< 83 04")
    assert [(each.answer.exception, each.function) for each in outcome.failures] == [(4, 0)]
    with pytest.raises(UnitFailed):
        played(writing(new(ALARM, "on"), has_turns=False), ">> 03 00 08 00 01\n<< 03 00")


def test_old_and_new_value_are_read_where_they_are_wanted():
    outcome = played(
        writing(new(LEVEL, "2.5"), shows=True),
        """
        >> 04 00 0C 00 01
        << 04 02 80 00
        >> 06 00 78 00 19
        << 06 00 78 00 19
        >> 04 00 0C 00 01
        << 04 02 00 19
        """,
    )
    (found,) = outcome.readings
    assert found.as_json(with_area=True) == {
        "point": "level",
        "area": "input",
        "address": 12,
        "reference": "30013",
        "value": 2.5,
        "old": None,
        "registers": [25],
    }


def test_what_was_written_somewhere_else_is_told_with_that_place():
    (found,) = played(writing(new(LEVEL, "2.5")), ">> 06 00 78 00 19\n<< 06 00 78 00 19").readings
    told = found.as_json(with_area=True)
    assert (told["area"], told["address"], told["reference"]) == ("holding", 120, "40121")


def test_a_number_that_means_no_value_is_told_as_it_was_written():
    (found,) = played(writing(new(LEVEL, "-3276.8")), ">> 06 00 78 80 00\n<< 06 00 78 80 00").readings
    assert found.value == -3276.8


def test_a_write_that_was_refused_is_told_with_its_function():
    (failure,) = played(writing(new(COUNT, "12")), ">> 10 00 14 00 02 04 00 00 00 0C\n<< 90 03").failures
    assert (failure.span.addresses, failure.function, failure.answer.exception) == ("20-21", 16, 3)


@pytest.mark.parametrize(
    ("functions", "has_turns", "conversation", "function"),
    [
        (None, True, ">>> 16 00 08 FF F7 00 08\n<< 96 01", 6),
        ({3, 22}, True, ">> 16 00 08 FF F7 00 08\n<< 96 01", 22),
        (None, False, ">> 03 00 08 00 01\n<< 03 02 00 00\n>> 06 00 08 00 08\n<< 86 01", 6),
    ],
)
def test_a_refused_write_of_bits_is_told_with_the_function_that_the_device_had_to_know(
    functions, has_turns, conversation, function
):
    (failure,) = played(writing(new(ALARM, "on", functions), has_turns=has_turns), conversation).failures
    assert failure.function == function
