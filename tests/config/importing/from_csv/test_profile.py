"""A sheet becomes a profile that passes its checks; what is not understood is a comment at its place."""

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.importing.from_csv.profile import profile_from_csv
from gateway.config.importing.imported import Imported, ImportedFileError
from gateway.config.load import parse
from gateway.config.plan.points import points_of
from gateway.config.problem import Problem
from gateway.profiles.columns import COLUMNS
from gateway.profiles.point import Point


def problems_of(text: str) -> tuple[Problem, ...]:
    return parse(text, port_trouble=lambda _: None).problems


def imported(text: str | bytes) -> Imported:
    content = text.encode() if isinstance(text, str) else text
    return profile_from_csv("table.csv", "kind", content, problems_of)


def points(text: str) -> list[Point]:
    """The points of a sheet of which nothing is left out."""
    profile = imported(text)
    assert profile.left_out == ()
    return points_in(profile.text)


def points_in(text: str) -> list[Point]:
    loaded = parse(f'{text}\n[[line]]\nport = "/dev/ttyS0"\n', port_trouble=lambda _: None)
    assert loaded.config is not None, f"{text}\n" + "\n".join(map(str, loaded.problems))
    profile = loaded.config.profile["kind"]
    return [*points_of(profile.points, profile)]


def point(heading: str, row: str) -> Point:
    """The one point of a sheet with one row."""
    (only,) = points(f"{heading}\n{row}\n")
    return only


def refusal(heading: str, row: str) -> str:
    """Why a row is left out, of a sheet in which another one is understood."""
    profile = imported(f"{heading}\n{row}\nfine;1\n")
    (why,) = profile.left_out
    assert f"  # {why.partition(': ')[2]}\n" in profile.text
    assert len(points_in(profile.text)) == 1
    return why


GERMAN = """Modbus-Liste Wärmepumpe;;;;;
Bezeichnung;Adresse;Typ;Faktor;Einheit;Lesen/Schreiben;Bemerkung
Vorlauf;0x0100;S16;0,1;°C;R;hinter dem Verdichter
Leistung;0x0102;U32;0,01;kW;R;
Sollwert;0x0104;S16;1/10;°C;R/W;
"""
CHINESE = """序号,参数名称,寄存器地址,功能码,数据类型,系数,单位,读写
1,A相电压,0,03,U16,0.1,V,只读
2,有功功率,1,03,S32,0.001,kW,只读
3,通断,16,01/05,bool,,,读写
"""
REFERENCES = """Point,Modicon,Format,Swap
Voltage,30001,REAL,CDAB
Current,30003,float,
Setpoint,40017,INT,
Pump,00002,BOOL,
Fault,10001,BOOL,
"""


def test_a_sheet_in_german():
    inlet, power, setpoint = points(GERMAN)
    assert (inlet.name, inlet.address, inlet.type, inlet.scale, inlet.unit) == ("vorlauf", 256, "int16", 0.1, "°C")
    assert (power.address, power.type, power.scale) == (258, "uint32", 0.01)
    assert [each.write for each in (inlet, power, setpoint)] == ["no", "no", "yes"]
    assert "  # hinter dem Verdichter\n" in imported(GERMAN).text


def test_a_sheet_in_chinese_from_a_spreadsheet_there():
    voltage, power, switch = points_in(imported(CHINESE.encode("gbk")).text)
    assert (voltage.name, voltage.area, voltage.address, voltage.scale) == ("a相电压", "holding", 0, 0.1)
    assert (power.type, power.count, power.unit) == ("int32", 2, "kW")
    assert (switch.area, switch.address, switch.write) == ("coils", 16, "yes")


def test_references_name_the_area_and_count_from_1():
    voltage, current, setpoint, pump, fault = points(REFERENCES)
    assert (voltage.area, voltage.address, voltage.type, voltage.swap) == ("input", 0, "float32", "words")
    assert (current.area, current.address) == ("input", 2)
    assert (setpoint.area, setpoint.address, setpoint.type) == ("holding", 16, "int16")
    assert [(each.area, each.address) for each in (pump, fault)] == [("coils", 1), ("discrete", 0)]


KEPWARE = """Tag Name,Address,Data Type,Respect Data Type,Client Access,Scan Rate,Scaling,Raw Low,Raw High,Scaled Low,\
Scaled High,Scaled Data Type,Clamp Low,Clamp High,Eng Units,Description,Negate Value
"Voltage","400001",Word,1,R/W,100,,,,,,,,,"V","",
"Power","400003",Float,1,RO,100,,,,,,,,,,"",
"Alarm","400020.3",Boolean,1,RO,1000,,,,,,,,,,"",
"Run","000005",Boolean,1,R/W,1000,,,,,,,,,,"",
"Energy","300011",DWord,1,RO,1000,Linear,0,1000,0,100,Double,0,0,,"",
"""


def test_tags_as_kepware_exports_them():
    profile, why, _ = imported(KEPWARE)
    voltage, power, alarm, run = points_in(profile)
    assert (voltage.area, voltage.address, voltage.type, voltage.unit) == ("holding", 0, "uint16", "V")
    assert [each.write for each in (voltage, power, alarm, run)] == ["yes", "no", "no", "yes"]
    assert (power.address, power.type, alarm.address, alarm.bits) == (2, "float32", 19, (3, 3))
    assert (run.area, run.address) == ("coils", 4)
    assert why == ('table.csv: row 6: Energy: "linear" is no number',)


MANUAL = """Register,Name,Type,Unit,Remark
30001,Outside temperature,INT16,0.1 °C,7FFFh: no sensor
30003-30004,Energy,UINT32,kWh,
30005-30006,Power,REAL,W,
30007,Status,bit field,,"bit 0: compressor, bit 1: pump"
40001,Set point,INT16,0.1 °C,20.0 to 55.0
"""


def test_a_page_of_a_manual_as_it_was_typed():
    found = [(each.name, each.area, each.address, each.type, each.scale, each.unit) for each in points(MANUAL)]
    assert found == [
        ("outside-temperature", "input", 0, "int16", 0.1, "°C"),
        ("energy", "input", 2, "uint32", 1, "kWh"),
        ("power", "input", 4, "float32", 1, "W"),
        ("status", "input", 6, "uint16", 1, ""),
        ("set-point", "holding", 0, "int16", 0.1, "°C"),
    ]


@pytest.mark.parametrize(
    ("heading", "row", "expected"),
    [
        ("Name;Address", "a b;7", {"name": "a-b", "area": "holding", "address": 7, "type": "uint16"}),
        ("Name;Address;Type;Quantity", "a;7;unsigned;2", {"type": "uint32", "count": 2}),
        ("Name;Address;Type;Registers", "a;7;int;4", {"type": "int64"}),
        ("Name;Address;Type", "a;7-8;unsigned", {"type": "uint32"}),
        ("Name;Address;Type;Size", "a;7;float;4 bytes", {"type": "float32"}),
        ("Name;Address;Type", "a;7;float", {"type": "float32"}),
        ("Name;Address;Type;Length", "a;7;string;8", {"type": "string", "count": 8}),
        ("Name;Address;Type", "a;7-10;ASCII", {"type": "string", "count": 4}),
        ("Name;Address;Type", "a;7;char[9]", {"type": "string", "count": 5}),
        ("Name;Address;Type", "a;7;byte", {"type": "uint8", "bits": (0, 7)}),
        ("Name;Address;Type", "a;7.b8;byte", {"type": "uint8", "bits": (8, 15)}),
        ("Name;Address;Type;Bits", "a;7;int8;high", {"type": "int8", "bits": (8, 15)}),
        ("Name;Address;Bit", "a;7;3", {"bits": (3, 3)}),
        ("Name;Address", "a;7.3", {"bits": (3, 3)}),
        ("Name;Address;Bits", "a;7;6-4", {"bits": (4, 6)}),
        ("Name;Address;Type", "a;7;BCD16", {"type": "bcd16"}),
        ("Name;Address;Gain", "a;7;10", {"scale": 0.1}),
        ("Name;Address;Scale", "a;7;10", {"scale": 10}),
        ("Name;Address;Exponent", "a;7;-2", {"scale": 0.01}),
        ("Name;Address;Exponent", "a;7;0", {"scale": 1}),
        ("Name;Address;Unit", "a;7;0.1V", {"scale": 0.1, "unit": "V"}),
        ("Name;Address;Unit;Scale", "a;7;0.1V;", {"scale": 1, "unit": "0.1V"}),
        ("Name;Address;Unit", "a;7;℃", {"unit": "°C"}),
        ("Name;Address;Unit", "a;7;n/a", {"unit": ""}),
        ("Name;Address;Type;Offset", "a;7;S16;-40", {"offset": -40}),
        ("Name;Address;Type;Word order", "a;7;U16;CDAB", {"swap": "none"}),
        ("Name;Address;Type;Word order", "a;7;U16;DCBA", {"swap": "bytes"}),
        ("Name;Address;Type;Invalid", "a;7;S16;0x8000; ", {"invalid": (-32768,)}),
        ("Name;Address;Labels", 'a;7;"0=off;1=on"', {"labels": {0: "off", 1: "on"}}),
        ("Name;Address;Values", "a;7;0: off, 1: on", {"labels": {0: "off", 1: "on"}}),
        ("Name;Address;Values", "a;7;0 - off / 1 - on / 0x10 - fault", {"labels": {0: "off", 1: "on", 16: "fault"}}),
        ("Name;Address;Values", 'a;7;"{""0"": ""off"", ""1"": ""on""}"', {"labels": {0: "off", 1: "on"}}),
        ("Name;Address;Values", "a;7;0-100", {"labels": {}}),
        ("Name;Address;Values", f"a;7;{'1:a' * 40_000}", {"labels": {}}),  # too long to look for labels in it
        ("Name;Address;Access;Min;Max", "a;7;RW;5;35", {"write": "yes", "minimum": 5, "maximum": 35}),
        ("Name;Address;Access", "a;7;W", {"write": "only"}),
        ("Name;Address;FC", "a;7;03/06", {"write": "yes", "write_function": "auto"}),
        ("Name;Address;FC", "a;7;03/16", {"write": "yes", "write_function": "multiple"}),
        ("Name;Address;FC;R/W", "a;7;03/16;R", {"write": "no"}),
        ("Name;Address;FC", "a;7;04", {"area": "input"}),
        ("Name;Address;Register type", "a;7;Input", {"area": "input"}),
        ("Name;Address;Access;Write at", "a;7;RW;107", {"write_at": 107}),
        ("Description;Address", "Phase voltage;7", {"name": "phase-voltage"}),
        ("Address;Type", "7;U16", {"name": "row-2"}),
        ("Name;Address", "input;7", {"name": "input-2"}),
        ("Name;Address", "3rd harmonic;7", {"name": "point-3rd-harmonic"}),
        ("Name;Address;Reference", "a;7;40008", {"area": "holding", "address": 7}),
        ("Name;Address;Reference", "a;7;see page 3", {"area": "holding", "address": 7}),
    ],
)
def test_what_a_row_says(heading, row, expected):
    found = point(heading, row)
    assert {key: getattr(found, key) for key in expected} == expected


def test_a_range_is_several_points():
    assert [each.name for each in points("Name;Address;Type\nrelay;0-2;U16\n")] == ["relay-0", "relay-1", "relay-2"]
    coils = points("Name;Address;Area\nrelay;0-7;coils\n")
    assert (len(coils), coils[7].address) == (8, 7)


def test_a_scale_may_be_the_name_of_another_point():
    current, _ = points("Name;Address;Type;Scale factor\nA;2;uint16;A_SF\nA_SF;6;sunssf;\n")
    assert current.scale_at == 6


def test_names_are_made_of_what_the_sheet_says_and_kept_in_a_sheet_of_ours():
    assert [each.name for each in points("Name;Address\nVpv1;1\nU L1;2\nu-l1;3\n")] == ["vpv1", "u-l1", "u-l1-2"]
    rows = [",".join(COLUMNS), "Vpv1,holding,1,40002", "U_L1.2,holding,2,40003"]
    assert [each.name for each in points("\n".join(rows))] == ["Vpv1", "U_L1.2"]


@pytest.mark.parametrize(
    ("heading", "row", "why"),
    [
        ("Name;Address", "a;top", '"top" is no address'),
        ("Name;Address;Type", "a;7;thing", '"thing" is no known type'),
        ("Name;Address;Type", "a;7;U24", "uint of 24 bits is not known here"),
        ("Name;Address;Type", "a;7;string", "a string needs a length"),
        ("Name;Address;Type;Quantity", "a;7;U16;2", "uint16 takes 1 registers, and it has 2"),
        ("Name;Address;Quantity", "a;7;2", "it has 2 registers, and no type"),
        ("Name;Address;Type", "a;7;bool", "is it a coil, a discrete input, or a bit of a register?"),
        ("Name;Address;Type;Bit", "a;7;float;3", "a bit of a float32 means nothing"),
        ("Name;Address;Bit", "a;7;x", '"x" is no bit'),
        ("Name;Address;Scale", "a;7;much", '"much" is no'),
        ("Name;Address;Scale", "a;7;0", '"0" is no factor'),
        ("Name;Address;Swap", "a;7;perhaps", '"perhaps" is no word order'),
        ("Name;Address;Area", "a;7;elsewhere", '"elsewhere" is no area'),
        ("Name;Address;Area;FC", "a;7;input;3", "it names two areas, holding and input"),
        ("Name;Address;FC", "a;7;1,3", "its functions are of several areas"),
        ("Name;Address;Access", "a;7;sometimes", '"sometimes" is no access'),
        ("Name;Address;Reference", "a;7;40007", "address 7 and reference 40007 are not the same place"),
        ("Name;Address;Unit", f"a;7;{'x' * 1001}", "a cell has more than 1000 characters"),
        ("Name;Address;Unit", "a;;V", "it has no address"),
        # What only the checks of the config know.
        ("Name;Address;Type", "a;65535;U32", "the point ends at 65536"),
        ("Name;Address;Area;Access", "a;7;input;RW", "cannot be written"),
        ("Name;Address;Min;Max;Access", "a;7;10;5;RW", "min"),
    ],
)
def test_a_row_that_is_not_understood_is_a_comment_at_its_place(heading, row, why):
    said = refusal(heading, row)
    assert said.startswith("table.csv: row 2: a: ")
    assert why in said


def test_several_rows_that_only_the_checks_refuse_are_left_out_and_no_others():
    profile = imported("Name;Address;Type\na;65535;U32\nb;1;U32\nc;65535;float\nd;2;U16\n")
    assert [why.split(": ")[2] for why in profile.left_out] == ["a", "c"]
    assert [each.name for each in points_in(profile.text)] == ["b", "d"]


def test_titles_reserved_registers_and_repeated_headings_are_no_points_and_no_errors():
    profile = imported("Name;Address\nElectrical;\na;1\nReserved;2\nName;Address\nb;3\n")
    assert profile.left_out == ()
    assert [each.name for each in points_in(profile.text)] == ["a", "b"]
    assert profile.text.index("  # Electrical\n") < profile.text.index('"a"')
    assert "  # row 4: Reserved\n" in profile.text


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("Name;Address\na;7\n", "counted from 0"),
        ("Name;Address\na;7\n", "No column names an area: all are holding registers"),
        ("Name;Address (from 1)\na;7\n", "counted from 1"),
        ("Name;Register\na;40001\n", "read as references"),
        ("Name;Address\na;0A\nb;10-11\n", "read as hexadecimal: 10 is 16"),
        ("Name;Register\na;32080\n", "read as addresses that count from 0"),
        ("Name;Address;Scale\na;7;10\nb;8;100\n", 'write "divisor"'),
    ],
)
def test_what_was_taken_for_granted_is_said(text, note):
    profile = imported(text)
    assert any(note in each for each in profile.notes)
    assert all(f"# {each}\n" in profile.text for each in profile.notes)


def test_nothing_is_taken_for_granted_if_the_sheet_says_it():
    assert imported("Name;Reference;Scale\na;40001;0.1\n").notes == ()


def test_columns_that_are_not_read_are_named():
    assert "; not read: Default, No.\n" in imported("Name;Address;Default;No.\na;1;0;1\n").text


def test_a_sheet_without_any_point_is_an_error_that_says_why():
    with pytest.raises(ImportedFileError, match=r"row 2: a: uint of 24 bits"):
        imported("Name;Address;Type\na;1;U24\n")


WORDS = st.sampled_from(
    [
        "1",
        "2",
        "100",
        "65535",
        "40001",
        "0x10",
        "1-4",
        "a",
        "b",
        "U16",
        "S32",
        "float",
        "string",
        "BCD",
        "bool",
        "R",
        "RW",
        "W",
        "0.1",
        "0",
        "-1",
        "ABCD",
        "CDAB",
        "x",
        "holding",
        "input",
        "coils",
        "0=off;1=on",
        "03",
        "3/16",
        "high",
        "4-6",
        "0x8000",
        "nan",
        "1e5",
        "-",
    ]
)


@given(
    rows=st.lists(st.lists(st.one_of(WORDS, st.text(max_size=6), st.just("")), max_size=len(COLUMNS)), max_size=4),
    columns=st.permutations(COLUMNS),
)
def test_whatever_the_sheet_says_the_profile_passes_its_checks(rows, columns):
    text = io.StringIO()
    csv.writer(text).writerows([columns, *rows])
    try:
        profile = imported(text.getvalue().encode("utf-8", "replace"))
    except ImportedFileError:
        return
    assert points_in(profile.text)
