"""`read`: what is asked for, and what is shown."""

import json
import time
from textwrap import dedent

import pytest

from gateway.cli.main import main
from gateway.cli.units import on_unit
from gateway.cli.units.values import table
from gateway.errors import GatewayError
from gateway.modbus.codes import Area
from gateway.operator.operations.answers.unit import RequestAnswer
from gateway.profiles.point import Point
from gateway.profiles.reading import Reading
from kit.control import FakeDaemon

POINTS = (
    Point("weight", Area.HOLDING, 0, "float32", count=2, decimals=2, unit="kg"),
    Point("state", Area.HOLDING, 2, labels={0: "off", 1: "running"}),
    Point("door", Area.DISCRETE, 3, "bit", labels={0: "closed", 1: "open"}),
    Point("zero", Area.HOLDING, 9, write="only"),
)


@pytest.fixture
def daemon(monkeypatch):
    it = FakeDaemon(POINTS)
    it.image.tables[Area.HOLDING].assign(0, (0x459C, 0x3D51, 1))
    monkeypatch.setattr(on_unit, "Conversation", it)
    return it


def test_all_points_of_a_device(daemon, capsys):
    assert main(["read", "silo-1"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        POINT   VALUE    UNIT  AREA      ADDRESS  REFERENCE  HEX
        weight  4999.66  kg    holding   0        40001      459C 3D51
        state   running        holding   2        40003      0001
        door    closed         discrete  3        10004      -
        """
    )
    assert daemon.asked == ["02 00 03 00 01", "03 00 00 00 03"]


def test_values_by_area_and_address(daemon, capsys):
    assert main(["read", "41", "holding", "0-2"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        ADDRESS  REFERENCE  VALUE  HEX
        0        40001      17820  459C
        1        40002      15697  3D51
        2        40003      1      0001
        """
    )


def test_bits_have_no_registers_to_show(daemon, capsys):
    assert main(["read", "41", "coils", "0-1", "--json"]) == 0
    values = json.loads(capsys.readouterr().out)["values"]
    assert values[1] == {"address": 1, "reference": "00002", "value": 0, "registers": []}
    assert main(["read", "41", "coils", "0"]) == 0
    assert capsys.readouterr().out == "ADDRESS  REFERENCE  VALUE\n0        00001      0\n"


def test_no_request_is_longer_than_the_unit_takes(daemon):
    """Its profile allows four registers, and no value is read in halves."""
    assert main(["read", "41", "holding", "1-6", "int32"]) == 0
    assert daemon.asked == ["03 00 01 00 04", "03 00 05 00 02"]


def test_json_has_area_values_and_registers(daemon, capsys):
    assert main(["read", "silo-1", "holding", "0", "float32", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "unit": 41,
        "name": "silo-1",
        "area": "holding",
        "values": [{"address": 0, "reference": "40001", "value": 4999.6646, "registers": [0x459C, 0x3D51]}],
        "elapsed_ms": 12.5,
    }


def test_json_of_points_has_their_names_and_units(daemon, capsys):
    assert main(["read", "silo-1", "door", "weight", "--json"]) == 0
    picture = json.loads(capsys.readouterr().out)
    assert "area" not in picture
    assert picture["values"][1] == {
        "point": "weight",
        "area": "holding",
        "address": 0,
        "reference": "40001",
        "value": 4999.66,
        "unit": "kg",
        "registers": [0x459C, 0x3D51],
    }
    assert picture["values"][0]["value"] == "closed"
    assert picture["elapsed_ms"] == 25.0


def test_json_knows_no_infinity(daemon, capsys):
    daemon.image.tables[Area.HOLDING].assign(0, (0x7F80, 0))
    assert main(["read", "silo-1", "weight", "--json"]) == 0
    (value,) = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)["values"]
    assert (value["value"], value["registers"]) == (None, [0x7F80, 0])


def test_raw_shows_request_and_response(daemon, capsys):
    assert main(["read", "silo-1", "state", "--raw"]) == 0
    assert capsys.readouterr().out.splitlines()[:2] == ["> 29 03 00 02 00 01", "< 29 03 02 00 01"]
    assert main(["read", "silo-1", "state", "--raw", "--json"]) == 0
    frames = json.loads(capsys.readouterr().out)["frames"]
    assert frames == [{"sent": "29 03 00 02 00 01", "received": "29 03 02 00 01"}]


def test_an_exception_of_the_device_is_told_and_status_1(daemon, capsys):
    assert main(["read", "41", "holding", "18-21"]) == 1
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err == "silo-1 (unit 41), holding 18-21: exception 02, illegal data address\n"


def test_an_exception_of_the_gateway_comes_with_its_reason(daemon, capsys):
    daemon.silent = {"result": "resting", "reason": ""}
    assert main(["read", "41", "holding", "0"]) == 1
    assert "0B, gateway target failed to respond: it backs off after several failures" in capsys.readouterr().err
    daemon.silent = {"result": "line_down", "reason": ""}
    assert main(["read", "41", "holding", "0"]) == 1
    assert ": its line is down; modbus-gateway status shows why" in capsys.readouterr().err
    daemon.silent = {"result": "line_down", "reason": "fleet://b: it is not heard"}
    assert main(["read", "41", "holding", "0"]) == 1
    assert capsys.readouterr().err.endswith(": fleet://b: it is not heard\n")
    daemon.silent = {"result": "refused", "reason": "profile weigher has no function 4"}
    assert main(["read", "41", "input", "0", "--json"]) == 1
    picture = json.loads(capsys.readouterr().out)
    assert picture["values"] == []
    assert picture["errors"] == [
        {
            "area": "input",
            "address": 0,
            "count": 1,
            "exception": 11,
            "reason": "exception 0B, gateway target failed to respond: profile weigher has no function 4",
        }
    ]


def test_points_are_read_over_gaps_and_what_is_refused_is_known_for_the_rest_of_the_command(monkeypatch, capsys):
    points = [Point(f"p{at}", Area.INPUT, at) for at in (1, 3, 6)]
    daemon = FakeDaemon(points, max_gap=2, ranges=((0, 4), (6, 9)))
    monkeypatch.setattr(on_unit, "Conversation", daemon)
    assert main(["read", "silo-1", "--count", "2", "--interval", "1ms"]) == 0
    assert capsys.readouterr().out.count("p6") == 2
    assert daemon.asked == ["04 00 01 00 06", *2 * ["04 00 01 00 03", "04 00 06 00 01"]]


def test_points_that_are_refused_together_are_read_one_by_one(monkeypatch, capsys):
    points = [Point(f"p{address}", Area.HOLDING, address) for address in (18, 19, 20)]
    daemon = FakeDaemon(points)
    monkeypatch.setattr(on_unit, "Conversation", daemon)
    assert main(["read", "silo-1"]) == 1
    told = capsys.readouterr()
    assert [line.split()[0] for line in told.out.splitlines()] == ["POINT", "p18", "p19"]
    assert told.err == "silo-1 (unit 41), holding 20: exception 02, illegal data address\n"
    assert daemon.asked == ["03 00 12 00 03", "03 00 12 00 01", "03 00 13 00 01", "03 00 14 00 01"]


def test_again_and_again_at_its_times(daemon, capsys, monkeypatch):
    slept = []
    monkeypatch.setattr(time, "sleep", slept.append)
    monkeypatch.setattr(time, "monotonic", lambda: 100.0)
    assert main(["read", "silo-1", "state", "-i", "500ms", "-n", "3"]) == 0
    headings, *rows = capsys.readouterr().out.splitlines()
    assert headings.split()[:3] == ["TIME", "POINT", "VALUE"]
    assert [row.split()[1:3] for row in rows] == [["state", "running"]] * 3
    assert slept == [0.0, 0.5, 1.0]  # the clock stands still
    slept.clear()
    assert main(["read", "silo-1", "state", "-n", "2", "--json"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert json.loads(first)["values"] == json.loads(second)["values"]
    assert "time" in json.loads(first)
    assert slept == [0.0, 1.0]


def test_a_failure_in_between_counts_and_is_no_end(daemon, capsys, monkeypatch):
    monkeypatch.setattr(time, "sleep", lambda _: daemon.silent.update({"result": "timeout"}) if daemon.asked else None)
    assert main(["read", "silo-1", "state", "-n", "2"]) == 1
    told = capsys.readouterr()
    assert len(told.out.splitlines()) == 2
    assert told.err.endswith("no response within its time limit\n")


def test_options_may_stand_between_the_words(daemon, capsys):
    for words in ("--json 41 holding 0", "41 --json holding 0", "41 holding --json 0", "41 holding 0 --json"):
        assert main(["read", *words.split()]) == 0
        assert json.loads(capsys.readouterr().out)["values"][0]["address"] == 0


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ("", "which unit? It is missing\n  help: modbus-gateway read UNIT"),
        ("41 40001", "40001 is a reference number: holding 0\n  help: modbus-gateway read 41 holding 0\n"),
        ("41 weihgt", 'has no point "weihgt"\n  help: did you mean "weight"?'),
        ("41 weight --profile mint", "--profile is for --port and --tcp"),
        ("41 holding 0 --port /dev/x --tcp x", "--port and --tcp are two ways to the unit"),
    ],
)
def test_wrong_words_are_answered_with_what_to_type(daemon, words, complaint, capsys):
    assert main(["read", *words.split()]) == 2
    assert complaint in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "complaint"),
    [
        ("-i 1", 'a duration needs a unit: write "1 ms" or "1 s"'),
        ("-i x", '"x" is not a valid duration'),
        ("-n 0", '"0" is not a number of times; write a number such as 10'),
        ("--swap all", "invalid choice: 'all'"),
        ("--baud fast", '"fast" is not a valid rate; write a number such as 9600'),
    ],
)
def test_wrong_options_are_refused(option, complaint, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["read", "41", *option.split()])
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err


def test_a_unit_that_the_daemon_does_not_have_is_a_problem(daemon, capsys):
    assert main(["read", "silo-2"]) == 1
    assert 'nothing has the name "silo-2"' in capsys.readouterr().err


def test_help_shows_an_example_in_80_columns(capsys):
    for verb in ("read", "write"):
        with pytest.raises(SystemExit):
            main([verb, "--help"])
        text = capsys.readouterr().out
        assert f"  modbus-gateway {verb} silo-1 " in text
        assert max(map(len, text.splitlines())) <= 80, text


def test_registers_do_not_steer_the_terminal(daemon, capsys):
    text = b"\x1b[2\nJ\x07"
    words = [int.from_bytes(text[at : at + 2].ljust(2, b"\0")) for at in range(0, len(text), 2)]
    daemon.image.tables[Area.HOLDING].assign(0, words)
    assert main(["read", "41", "holding", f"0-{len(words) - 1}", "string"]) == 0
    told = capsys.readouterr().out
    assert told.replace("\n", "").isprintable()
    assert r"\x1b[2\nJ\x07" in told


def test_what_a_unit_or_the_gateway_says_does_not_steer_the_terminal_either(daemon, capsys, monkeypatch):
    def refuse(*_):
        raise GatewayError("no \x1b[2J\u202eunit")

    monkeypatch.setattr(on_unit, "Conversation", refuse)
    assert main(["read", "41", "holding", "0"]) == 1
    assert capsys.readouterr().err == "modbus-gateway: error: no \\x1b[2J\\u202eunit\n"


@pytest.mark.parametrize(
    ("area", "address", "advice"),
    [
        ("holding", 40001, "\n  help: 40001 of a manual is holding 0 here\n"),
        ("input", 30010, "\n  help: 30010 of a manual is input 9 here\n"),
        ("holding", 30010, "\n"),
        ("holding", 40000, "\n"),
    ],
)
def test_the_number_of_a_manual_is_named_after_an_address_that_does_not_exist(daemon, capsys, area, address, advice):
    assert main(["read", "41", area, str(address)]) == 1
    assert capsys.readouterr().err.endswith("exception 02, illegal data address" + advice)


def test_bits_of_a_register_are_a_row_each_and_one_request(monkeypatch, capsys):
    daemon = FakeDaemon(
        (
            Point("ready", Area.HOLDING, 9, bits=(3, 3)),
            Point("mode", Area.HOLDING, 9, bits=(4, 6), labels={2: "eco"}),
            Point("step", Area.HOLDING, 9, "uint8", bits=(8, 15)),
        )
    )
    daemon.image.tables[Area.HOLDING].assign(9, (0x0728,))
    monkeypatch.setattr(on_unit, "Conversation", daemon)
    assert main(["read", "silo-1"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        POINT  VALUE  AREA     ADDRESS  REFERENCE   HEX
        ready  1      holding  9.3      40010.3     0728
        mode   eco    holding  9.4-6    40010.4-6   0728
        step   7      holding  9.8-15   40010.8-15  0728
        """
    )
    assert daemon.asked == ["03 00 09 00 01"]
    assert main(["read", "silo-1", "mode", "--json"]) == 0
    (value,) = json.loads(capsys.readouterr().out)["values"]
    assert (value["address"], value["reference"], value["bits"]) == (9, "40010", [4, 6])


@pytest.mark.parametrize(
    ("words", "registers", "shown"),
    [
        (["holding", "0", "float32"], (0x7FC0, 0), "0        40001      –      7FC0 0000"),  # noqa: RUF001
        (["holding", "0", "float32"], (0xFF80, 0), "0        40001      –      FF80 0000"),  # noqa: RUF001
        (["holding", "0", "bcd16"], (0x12FA,), "0        40001      –      12FA"),  # noqa: RUF001
        (["flow"], (0x8000,), "flow   –      m³/h  holding  0        40001      8000"),  # noqa: RUF001
    ],
)
def test_no_value_is_a_dash_with_its_registers_and_nothing_that_went_wrong(
    monkeypatch, capsys, words, registers, shown
):
    daemon = FakeDaemon([Point("flow", Area.HOLDING, 0, "int16", scale=0.1, unit="m³/h", invalid=(-0x8000,))])
    daemon.image.tables[Area.HOLDING].assign(0, registers)
    monkeypatch.setattr(on_unit, "Conversation", daemon)
    assert main(["read", "silo-1", *words]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[1] == shown
    assert err == "– is no value: the device says that it has none, or the registers hold no number\n"  # noqa: RUF001
    assert main(["read", "silo-1", *words, "--json"]) == 0
    out, err = capsys.readouterr()
    (value,) = json.loads(out)["values"]
    assert (value["value"], value["registers"], err) == (None, [*registers], "")


def test_registers_of_four_bytes_are_told_whole(monkeypatch, capsys):
    daemon = FakeDaemon(wide={"input": ((10, 19),)})
    monkeypatch.setattr(on_unit, "Conversation", daemon)
    monkeypatch.setattr(daemon, "_request", lambda unit, pdu: RequestAnswer(41, "04 08 00 01 00 00 FF FF FF FF", 1.0))
    assert main(["read", "41", "input", "10-11"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        ADDRESS  REFERENCE  VALUE       HEX
        10       30011      65536       00010000
        11       30012      4294967295  FFFFFFFF
        """
    )
    assert main(["read", "41", "input", "0-1"]) == 1
    assert "the response carries 8 bytes, and 4 were asked for" in capsys.readouterr().err


def test_of_a_long_text_the_first_registers_are_shown():
    point = Point("maker", Area.HOLDING, 0, "string", count=9)
    shown = table([Reading(point, b"AB" * 9)]).splitlines()[1]
    assert shown.endswith(" 4142 4142 4142 4142 4142 4142 4142 4142 …")
    assert table([Reading(point, b"AB" * 9)]).count("4142") == 8
