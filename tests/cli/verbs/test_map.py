"""`map`, and the tables of `check`: what stands at each address of a unit, and where it comes from."""

import csv
import json
from io import StringIO
from textwrap import dedent, indent

import pytest

from gateway.cli.main import main

FILE = """\
[[line]]
name = "hall"
port = "/dev/null"
devices = [
  { unit = 1, as = 41, name = "meter-1", profile = "meter" },
  { unit = 2, as = 42, name = "meter-2", profile = "meter" },
  { unit = 3, as = 43, name = "press" },
]
[profile.meter]
points = [
  { name = "power", holding = 10, type = "int32", scale = 0.1, unit = "kW", write = true },
  { name = "state", holding = 12, bits = "0-3", labels = { 0 = "off", 1 = "on" } },
  { name = "energy", holding = 14, type = "uint32", scale_from = "energy-scale", unit = "kWh" },
  { name = "energy-scale", holding = 16, type = "int16" },
  { name = "reset", holding = 20, write = "only" },
]
[[image]]
unit = 200
name = "shift"
profile = "meter"
holding = "8-15"
[[image]]
unit = 201
name = "copy"
of = "meter-1"
stale = "5 s"
read = [{ holding = "8-12", every = "500 ms" }]
[[image]]
unit = 240
name = "block"
stale = "5 s"
holding = "40-49"
map = [
  { at = 0, device = "meter-1", point = "power", type = "float32", swap = "words", every = "1 s" },
  { at = 2, device = "meter-2", point = "power", every = "1 s", write = true },
  { at = 8, device = "meter-2", holding = "12-16", every = "2 s", when_stale = 0x7FC0 },
  { at = 13, device = "press", holding = "0-3", swap = "both", every = "1 s" },
  { at = 17, fresh = ["meter-1", "meter-2"] },
  { at = 18, age = "press" },
  { at = 0, area = "coils", device = "press", coils = "0-7", every = "1 s", write = true },
]
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "gateway.toml"
    path.write_text(FILE, encoding="utf-8")
    return str(path)


def test_check_shows_a_virtual_unit_as_a_table_with_gaps_and_own_registers(config, capsys):
    assert main(["check", config]) == 0
    said = capsys.readouterr().out
    table = """\
        Virtual unit 240, block: profile generic, values older than 5 s are stale
          ADDRESS        REFERENCE  DEVICE       POINT  THERE          TYPE           EVERY  WRITE  STALE   MEANING
          coils 0-7      00001      press        -      coils 0-7      bit            1 s    yes    0B
          holding 0-1    40001      meter-1      power  holding 10-11  float32 words  1 s    -      0B      kW
          holding 2-3    40003      meter-2      power  holding 10-11  int32          1 s    yes    0B      x 0.1 kW
          holding 4-7    40005      nothing: 02
          holding 8-12   40009      meter-2      -      holding 12-16  as there       2 s    -      0x7FC0
          holding 13-16  40014      press        -      holding 0-3    both           1 s    -      0B
          holding 17     40018      fresh                              bits                  -              1 while its values are fresh, from bit 0 on: meter-1, meter-2
          holding 18     40019      press                              uint16                -              seconds since its last answer; 65535: none yet
          holding 19-39  40020      nothing: 02
          holding 40-49  40041      its own                                                  yes
          Longest wait 3.31 s: of reads at the start and after a write, and of writes. All others wait for no line.
          One device that does not answer makes every read with values of it 0B, that of a whole block, too.
        """  # noqa: E501 - as it is printed
    assert dedent(table) in said
    assert "nothing is at holding 4-7, 19-39: a read over it is answered 02" in said


def test_check_says_through_which_units_a_device_can_be_written(config, capsys):
    main(["check", config])
    said = capsys.readouterr().out
    table = """\
          UNIT  ON THE WIRE  DEVICE   PROFILE  LONGEST WAIT  WRITTEN THROUGH, TOO
          41    1            meter-1  meter    3.31 s        201 copy
          42    2            meter-2  meter    3.31 s        240 block
          43    3            press    generic  3.31 s        240 block
        """
    assert indent(dedent(table), "  ") in said
    main(["check", "--json", config])
    units = json.loads(capsys.readouterr().out)["lines"][0]["units"]
    assert [unit["written_through"] for unit in units] == [["201 copy"], ["240 block"], ["240 block"]]


def test_units_that_pass_through_are_named_each_for_itself(tmp_path, capsys):
    text = '[[line]]\nname = "a"\nport = "/dev/null"\n[[image]]\nunit = 240\nname = "block"\n'
    row = 'map = [{ at = 0, device = "a/7", holding = "0-1", every = "1 s", write = true }]\n'
    path = tmp_path / "gateway.toml"
    path.write_text(text + row, encoding="utf-8")
    assert main(["check", str(path)]) == 0
    assert "\n  a/7 is written through 240 block, too.\n" in capsys.readouterr().out


def test_a_single_device_makes_no_block_stale(config, tmp_path, capsys):
    path = tmp_path / "one.toml"
    start = FILE.index("map = [")
    path.write_text(FILE[:start] + 'map = [{ at = 0, device = "press", holding = 0, every = "1 s" }]', encoding="utf-8")
    main(["check", str(path)])
    assert "One device" not in capsys.readouterr().out


def test_a_gap_of_one_register_is_shown_and_none_between_areas(config, tmp_path, capsys):
    path = tmp_path / "one.toml"
    rows = [f'{{ at = {at}, device = "press", holding = 0, every = "1 s" }}' for at in (0, 2)]
    rows.append('{ at = 9, area = "coils", device = "press", coils = 0, every = "1 s" }')
    path.write_text(f"{FILE[: FILE.index('map = [')]}map = [{', '.join(rows)}]", encoding="utf-8")
    main(["check", "--json", str(path)])
    (unit,) = json.loads(capsys.readouterr().out)["virtual_units"]
    assert [(row["area"], row["first"], row["what"]) for row in unit["map"]][:4] == [
        ("coils", 9, "value"),
        ("holding", 0, "value"),
        ("holding", 1, "gap"),
        ("holding", 2, "value"),
    ]


def test_check_tells_programs_the_same(config, capsys):
    main(["check", "--json", config])
    (unit,) = json.loads(capsys.readouterr().out)["virtual_units"]
    rows = unit.pop("map")
    assert unit.pop("longest_wait_ms") == pytest.approx(3310, abs=10)
    assert unit == {"unit": 240, "name": "block", "profile": "generic", "stale_ms": 5000.0}
    assert [(row["area"], row["first"], row["last"], row["what"]) for row in rows] == [
        ("coils", 0, 7, "value"),
        ("holding", 0, 1, "value"),
        ("holding", 2, 3, "value"),
        ("holding", 4, 7, "gap"),
        ("holding", 8, 12, "value"),
        ("holding", 13, 16, "value"),
        ("holding", 17, 17, "fresh"),
        ("holding", 18, 18, "age"),
        ("holding", 19, 39, "gap"),
        ("holding", 40, 49, "own"),
    ]
    assert rows[2] == {
        "area": "holding",
        "first": 2,
        "last": 3,
        "what": "value",
        "device": "meter-2",
        "there": "holding 10-11",
        "point": "power",
        "type": "int32",
        "swap": "",
        "scale": 0.1,
        "offset": 0.0,
        "scale_at": "",
        "unit": "kW",
        "every_ms": 1000.0,
        "write": True,
        "when_stale": "exception",
    }


def mapped(capsys, config, *words):
    assert main(["map", "--config", config, "--control", f"{config}.no-socket", *words]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("unit", ["block", "240"])
def test_the_map_of_a_virtual_unit(config, capsys, unit):
    table = """\
        Unit 240, block
          ADDRESS        REFERENCE  NAME                  TYPE            UNIT                   SOURCE                 EVERY  WRITE
          coils 0-7      00001      -                     bit                                    press coils 0-7        1 s    yes
          holding 0-1    40001      meter-1.power         float32 words   kW                     meter-1 holding 10-11  1 s    -
          holding 2-3    40003      meter-2.power         int32           x 0.1 kW               meter-2 holding 10-11  1 s    yes
          holding 8.0-3  40009.0-3  meter-2.state         uint16                                 meter-2 holding 12     2 s    -
          holding 9      40010      -                     registers                              meter-2 holding 13     2 s    -
          holding 10-11  40011      meter-2.energy        uint32          x 10^(holding 12) kWh  meter-2 holding 14-15  2 s    -
          holding 12     40013      meter-2.energy-scale  int16                                  meter-2 holding 16     2 s    -
          holding 13-16  40014      -                     registers both                         press holding 0-3      1 s    -
          holding 17.0   40018.0    meter-1.fresh         bit                                    meter-1                       -
          holding 17.1   40018.1    meter-2.fresh         bit                                    meter-2                       -
          holding 18     40019      press.age             uint16          s                      press                         -
          holding 40-49  40041      -                     registers                              its own                       yes
        """  # noqa: E501 - as it is printed
    assert mapped(capsys, config, unit) == dedent(table)


def test_the_map_as_csv_has_a_row_for_each_value(config, capsys):
    rows = list(csv.DictReader(StringIO(mapped(capsys, config, "block", "--csv"))))
    assert [row["name"] for row in rows if row["name"]] == [
        "meter-1.power",
        "meter-2.power",
        "meter-2.state",
        "meter-2.energy",
        "meter-2.energy-scale",
        "meter-1.fresh",
        "meter-2.fresh",
        "press.age",
    ]
    cells = {row["name"]: row for row in rows}
    power, state, energy = cells["meter-1.power"], cells["meter-2.state"], cells["meter-2.energy"]
    assert [
        power[key] for key in ("area", "address", "reference", "count", "type", "word order", "unit", "access")
    ] == [*("holding", "0", "40001", "2", "float32", "words", "kW", "r")]
    assert [power[key] for key in ("device", "point", "source", "every")] == [
        "meter-1",
        "power",
        "holding 10-11",
        "1 s",
    ]
    assert (cells["meter-2.power"]["scale"], cells["meter-2.power"]["access"]) == ("0.1", "rw")
    assert (state["bits"], state["labels"], energy["scale from"]) == ("0-3", "0=off;1=on", "meter-2.energy-scale")
    assert cells["meter-2.fresh"]["bits"] == "1"


def test_another_gateway_reads_the_csv(config, tmp_path, capsys):
    path = tmp_path / "block.csv"
    path.write_text(mapped(capsys, config, "block", "--csv"), encoding="utf-8")
    main(["import", "csv", str(path), "--name", "block"])
    said = capsys.readouterr().out
    assert '{ name = "meter-1.power", holding = 0, type = "float32", swap = "words", unit = "kW" }' in said
    assert 'scale_from = "meter-2.energy-scale"' in said


def test_the_map_of_an_image_a_mirror_and_a_device(config, capsys):
    assert [line.split()[:4] for line in mapped(capsys, config, "shift").splitlines()[2:]] == [
        ["holding", "8-9", "40009", "-"],
        ["holding", "10-11", "40011", "power"],
        ["holding", "12.0-3", "40013.0-3", "state"],
        ["holding", "13-15", "40014", "-"],
    ]
    copy = mapped(capsys, config, "copy").splitlines()
    assert copy[0] == "Unit 201, copy"
    assert " ".join(copy[3].split()) == "holding 10-11 40011 power int32 x 0.1 kW meter-1 holding 10-11 500 ms yes"
    assert copy[4].split()[-1] == "-"
    meter = json.loads(mapped(capsys, config, "41", "--json"))
    assert (meter["unit"], meter["name"]) == (41, "meter-1")
    assert [(row["name"], row["first"], row["write"]) for row in meter["map"]] == [
        ("power", 10, True),
        ("state", 12, False),
        ("energy", 14, False),
        ("energy-scale", 16, False),
        ("reset", 20, True),
    ]


def test_a_unit_that_has_no_map(config, tmp_path, capsys):
    assert main(["map", "press", "--config", config]) == 2
    assert capsys.readouterr().err == (
        "modbus-gateway: error: press has no points, which say what its registers mean\n"
        "  help: give points to its profile, or to the device itself, in the config\n"
    )
    assert main(["map", "blok", "--config", config]) == 2
    assert 'there is no unit "blok" in the config\n  help: did you mean "block"?' in capsys.readouterr().err
    broken = tmp_path / "broken.toml"
    broken.write_text(FILE.replace('"meter-1", "meter-2"]', '"metre"]'), encoding="utf-8")
    assert main(["map", "block", "--config", str(broken)]) == 1
    assert 'no row of this map reads "metre"' in capsys.readouterr().err
