"""`write`: what is sent, and what is shown and refused."""

import json
from textwrap import dedent

import pytest

from gateway.cli.main import main
from gateway.cli.units import on_unit
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.unit import RequestAnswer
from gateway.profiles.point import Point
from kit.control import FakeDaemon

POINTS = (
    Point("weight", Area.HOLDING, 0, "float32", count=2),
    Point("speed", Area.HOLDING, 2, "int16", scale=0.1, write="yes"),
    Point("state", Area.HOLDING, 3, labels={0: "off", 1: "running"}, write="yes"),
    Point("valve", Area.COILS, 3, "bit", write="yes"),
    Point("zero", Area.HOLDING, 9, labels={187: "take"}, write="only"),
    Point("pump", Area.HOLDING, 8, bits=(3, 3), write="yes"),
    Point("mode", Area.HOLDING, 8, bits=(4, 6), labels={2: "eco"}, write="yes"),
    Point("flow", Area.INPUT, 12, "int16", write="yes", write_at=15),
    Point("limit", Area.HOLDING, 11, minimum=10, maximum=20, write="yes", write_function="multiple"),
    Point("power", Area.HOLDING, 16, "int16", scale_at=17, write="yes"),
    Point("alarm", Area.HOLDING, 8, bits=(9, 9)),
)


@pytest.fixture
def daemon(monkeypatch):
    it = FakeDaemon(POINTS)
    monkeypatch.setattr(on_unit, "Conversation", it)
    return it


@pytest.mark.parametrize(
    ("words", "request_pdu"),
    [
        ("speed -2.5", "06 00 02 FF E7"),
        ("state running", "06 00 03 00 01"),
        ("valve on", "05 00 03 FF 00"),
        ("zero take", "06 00 09 00 BB"),
        ("valve on --multiple", "0F 00 03 00 01 01 01"),
        ("pump on", "16 00 08 FF F7 00 08"),
        ("mode eco", "16 00 08 FF 8F 00 20"),
        ("flow -2", "06 00 0F FF FE"),
        ("limit 20", "10 00 0B 00 01 02 00 14"),
        ("holding 5 0x10", "06 00 05 00 10"),
        ("holding 5 1 2", "10 00 05 00 02 04 00 01 00 02"),
        ("holding 5 1.5 float32", "10 00 05 00 02 04 3F C0 00 00"),
        ("holding 5 1.5 float32 --swap words", "10 00 05 00 02 04 00 00 3F C0"),
        ("holding 5 -5", "none"),
        ("holding 5 -5 int16", "06 00 05 FF FB"),
        ("holding 5 AB string", "06 00 05 41 42"),
        ("coils 0 1 0 on", "0F 00 00 00 03 01 05"),
    ],
)
def test_one_item_goes_with_05_or_06_and_several_with_15_or_16(daemon, words, request_pdu):
    code = main(["write", "silo-1", *words.split()])
    assert daemon.asked == ([] if request_pdu == "none" else [request_pdu])
    assert code == (2 if request_pdu == "none" else 0)


@pytest.mark.parametrize(
    ("functions", "request_pdu"),
    [((3, 16), "10 00 03 00 01 02 00 01"), ((3, 6, 16), "06 00 03 00 01"), ((3,), "06 00 03 00 01")],
)
def test_a_unit_that_does_not_know_06_gets_16(monkeypatch, functions, request_pdu):
    daemon = FakeDaemon(POINTS, functions=functions)
    monkeypatch.setattr(on_unit, "Conversation", daemon)
    assert main(["write", "silo-1", "state", "1"]) == 0
    assert daemon.asked == [request_pdu]


def test_what_was_written_is_shown(daemon, capsys):
    assert main(["write", "silo-1", "speed", "-2.5"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        POINT  VALUE  AREA     ADDRESS  REFERENCE  HEX
        speed  -2.5   holding  2        40003      FFE7
        """
    )


def test_show_reads_before_and_after(daemon, capsys):
    daemon.image.tables[Area.HOLDING].assign(5, (7, 8))
    assert main(["write", "silo-1", "holding", "5", "1", "2", "--show"]) == 0
    assert [pdu[:2] for pdu in daemon.asked] == ["03", "10", "03"]
    assert capsys.readouterr().out == dedent(
        """\
        ADDRESS  REFERENCE  OLD  VALUE  HEX
        5        40006      7    1      0001
        6        40007      8    2      0002
        """
    )


def test_what_cannot_be_read_is_shown_as_written(daemon, capsys):
    assert main(["write", "silo-1", "zero", "take", "--show", "--json"]) == 0
    assert len(daemon.asked) == 1
    (value,) = json.loads(capsys.readouterr().out)["values"]
    assert (value["value"], value["registers"]) == ("take", [187])
    assert "old" not in value


def test_json_has_old_and_new_value(daemon, capsys):
    assert main(["write", "silo-1", "state", "running", "--show", "--json", "--raw"]) == 0
    picture = json.loads(capsys.readouterr().out)
    (value,) = picture["values"]
    assert (value["old"], value["value"]) == ("off", "running")
    assert len(picture["frames"]) == 3


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("speed 5000", "5000 does not fit into int16: -3276.8 to 3276.7"),
        ("speed 0.05", "0.05 is not a multiple of 0.1, the scale of speed"),
        ("state walking", '"walking" is not a number; it has the labels off, running'),
        ("valve 2", "2 is not a bit: write 0 or 1, off or on"),
        ("holding 0 70000", "70000 does not fit into uint16: 0 to 65535"),
        ("weight 5", "weight is read-only"),
        ("limit 9", "9 is too low: limit must be 10 to 20"),
        ("limit 20.5", "20.5 is too high: limit must be 10 to 20"),
        ("mode 8", "8 does not fit into bits 4-6: 0 to 7"),
        ("alarm on", "add write = true to the point in the config\n"),
        ("input 0 5", "input cannot be written; coils and holding can"),
        ("holding 0,1 5", '"0,1" is not an address\n  help: modbus-gateway write silo-1 holding 0 5\n'),
        ("holding 400001 5", "not an address\n  help: modbus-gateway write silo-1 holding 0 5\n"),
        ("", "say what to write\n  help: modbus-gateway write silo-1 speed 1"),
    ],
)
def test_what_cannot_be_written_is_refused_and_nothing_is_sent(daemon, words, complaint, capsys):
    assert main(["write", "silo-1", *words.split()]) == 2
    assert complaint in capsys.readouterr().err
    assert daemon.asked == []


def test_more_than_one_request_can_carry_is_refused(daemon, capsys):
    assert main(["write", "silo-1", "holding", "0", *["1"] * 124]) == 2
    assert "124 registers are too many for one request\n  help: write at most 123 at a time" in capsys.readouterr().err


def test_an_exception_is_told_and_what_else_to_try(daemon, capsys):
    assert main(["write", "41", "holding", "30", "1"]) == 1
    said = "silo-1 (unit 41), holding 30: exception 02, illegal data address\n"
    assert capsys.readouterr().err == "through /run/gw.sock\n" + said


def test_a_device_that_may_not_know_06_is_worth_another_try(daemon, capsys, monkeypatch):
    monkeypatch.setattr(daemon, "_request", lambda unit, pdu: RequestAnswer(41, "86 01", 1.0))
    assert main(["write", "41", "holding", "3", "1", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["area"] == "holding"
    assert main(["write", "41", "holding", "3", "1"]) == 1
    said = capsys.readouterr().err
    assert "\n  help: this client may not write there: modbus-gateway check" in said
    assert "if the unit does not know function 06: --multiple writes with 16" in said


def test_a_write_that_the_gateway_refuses_for_the_unit_is_nothing_that_rights_allow(daemon, capsys, monkeypatch):
    refusal = {"unit": 41, "pdu": "86 01", "elapsed_ms": 1.0, "result": "refused", "reason": "it is read-only"}
    monkeypatch.setattr(daemon, "_request", lambda unit, pdu: RequestAnswer(**refusal))
    assert main(["write", "41", "holding", "3", "1"]) == 1
    assert capsys.readouterr().err.endswith(
        "\nsilo-1 (unit 41), holding 3: exception 01, illegal function: it is read-only\n"
    )


def test_a_write_that_the_rights_forbid_is_not_to_be_sent_in_another_way(daemon, capsys, monkeypatch):
    refusal = {"unit": 41, "pdu": "86 01", "elapsed_ms": 1.0, "result": "denied", "reason": "write"}
    monkeypatch.setattr(daemon, "_request", lambda unit, pdu: RequestAnswer(**refusal))
    assert main(["write", "41", "holding", "3", "1"]) == 1
    said = capsys.readouterr().err
    assert (
        "[[access]] does not allow it for the control socket\n  help: modbus-gateway check shows the rights\n" in said
    )
    assert "--multiple" not in said


def test_which_unit_must_be_said(capsys):
    assert main(["write"]) == 2
    assert "which unit? It is missing" in capsys.readouterr().err


def test_the_number_of_a_manual_is_named_after_an_address_that_does_not_exist(daemon, capsys):
    assert main(["write", "41", "holding", "40004", "1"]) == 1
    assert "exception 02, illegal data address\n  help: 40004 of a manual is holding 3 here" in capsys.readouterr().err


def test_a_type_before_the_value_is_put_behind_it(daemon, capsys):
    assert main(["write", "41", "holding", "0", "float32", "1.5"]) == 2
    assert capsys.readouterr().err.endswith(
        "the type is the last word\n  help: modbus-gateway write 41 holding 0 1.5 float32\n"
    )


def test_it_says_which_gateway_it_asks(daemon, capsys):
    assert main(["write", "41", "holding", "3", "1"]) == 0
    assert capsys.readouterr().err == "through /run/gw.sock\n"
    assert main(["write", "41", "holding", "3", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["through"] == "/run/gw.sock"


def test_bits_are_written_in_one_turn_where_the_profile_does_not_name_function_22(daemon, monkeypatch):
    assert main(["write", "silo-1", "pump", "on"]) == 0
    assert daemon.questions[-1]["in_one_turn"] == 6
    naming = FakeDaemon(POINTS, functions=(3, 16, 22))
    monkeypatch.setattr(on_unit, "Conversation", naming)
    assert main(["write", "silo-1", "pump", "on"]) == 0
    assert naming.questions[-1]["in_one_turn"] == 0


def test_the_other_bits_of_a_register_are_not_known_after_a_write_unless_it_is_read(daemon, capsys):
    daemon.image.tables[Area.HOLDING].assign(8, (0x0121,))
    assert main(["write", "silo-1", "mode", "eco"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        POINT  VALUE  AREA     ADDRESS  REFERENCE  HEX
        mode   eco    holding  8.4-6    40009.4-6  -
        """
    )
    assert main(["write", "silo-1", "pump", "on", "--show"]) == 0
    assert [pdu[:2] for pdu in daemon.asked] == ["16", "03", "16", "03"]
    assert capsys.readouterr().out == dedent(
        """\
        POINT  OLD  VALUE  AREA     ADDRESS  REFERENCE  HEX
        pump   0    1      holding  8.3      40009.3    0129
        """
    )


def test_a_value_with_a_scale_register_is_written_after_that_was_read(daemon, capsys):
    daemon.image.tables[Area.HOLDING].assign(17, (0xFFFF,))
    assert main(["write", "silo-1", "power", "12.5", "--json"]) == 0
    assert daemon.asked == ["03 00 10 00 02", "06 00 10 00 7D"]
    (value,) = json.loads(capsys.readouterr().out)["values"]
    assert (value["value"], value["registers"]) == (12.5, [125])
    daemon.image.tables[Area.HOLDING].assign(17, (0x8000,))
    assert main(["write", "silo-1", "power", "12.5"]) == 1
    assert "the device has no scale for power now" in capsys.readouterr().err
    assert len(daemon.asked) == 3
