"""Sheets as programs save them: encodings, delimiters, titles above the heading."""

import pytest

from gateway.config.importing.from_csv.headings import columns_of, known_columns
from gateway.config.importing.from_csv.sheet import read_sheet
from gateway.config.importing.imported import ImportedFileError
from gateway.profiles.columns import COLUMNS

TEXT = "Name;Address;Unit\nGröße;1;°C\n"


def read(content: bytes | str):
    return read_sheet("a.csv", content.encode() if isinstance(content, str) else content, known_columns)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
def test_the_encodings_of_spreadsheets(encoding):
    sheet = read(TEXT.encode(encoding))
    assert sheet.heading.cells == ("Name", "Address", "Unit")
    assert [row.cells for row in sheet.rows] == [("Größe", "1", "°C")]


@pytest.mark.parametrize("encoding", ["gbk", "utf-8"])
def test_a_sheet_from_china(encoding):
    sheet = read("名称,地址,单位\n电压,1,V\n".encode(encoding))
    assert sheet.rows[0].cells == ("电压", "1", "V")


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|"])
def test_the_delimiter_is_found_by_the_heading(delimiter):
    sheet = read(TEXT.replace(";", delimiter))
    assert sheet.rows[0].cells == ("Größe", "1", "°C")
    assert sheet.has_decimal_comma == (delimiter != ",")


def test_commas_in_cells_do_not_make_it_a_sheet_of_commas():
    assert len(read("Name;Address;Note\na;1;1,2,3,4,5\n").heading.cells) == 3


def test_a_title_and_empty_rows_stand_above_the_heading_and_count_as_rows():
    sheet = read('Modbus map, version 3\n\n"Name","Address\n(dec)"\na,1\n\nb,2\n')
    assert sheet.heading.number == 3
    assert [row.number for row in sheet.rows] == [4, 6]


@pytest.mark.parametrize(
    "content",
    ["", "\n\n", "a;b;c\n1;2;3\n", "Name;Unit\na;V\n", "\0\0\0", b"\xff\xfe", b"\xff", "x" * 200_000],
)
def test_what_is_no_sheet(content):
    with pytest.raises(ImportedFileError, match=r"a\.csv: "):
        read(content)


def test_a_cell_without_an_end_is_an_error_and_not_endless():
    with pytest.raises(ImportedFileError, match=r"a\.csv: line 2: field larger than"):
        read('Name;Address\n"' + "x" * 200_000)


def test_too_many_rows():
    with pytest.raises(ImportedFileError, match="more than 10000 rows"):
        read("Name;Address\n" + "a;1\n" * 10_001)


@pytest.mark.parametrize(
    ("heading", "column"),
    [
        ("Register Address (Decimal)", "address"),
        ("Modbus-Adresse", "address"),
        ("ADDR.", "address"),
        ("寄存器地址", "address"),
        ("Modicon", "reference"),
        ("Bezeichnung", "name"),
        ("参数名称", "name"),
        ("Data Type", "type"),
        ("Datentyp", "type"),
        ("数据类型", "type"),
        ("Function Code", "function"),
        ("FC", "function"),
        ("功能码", "function"),
        ("Register type", "area"),
        ("Scale factor", "scale"),
        ("Skalierung", "scale"),
        ("系数", "scale"),
        ("Gain", "divisor"),
        ("Teiler", "divisor"),
        ("R/W", "access"),
        ("Read / Write", "access"),
        ("读写", "access"),
        ("Einheit", "unit"),
        ("单位", "unit"),
        ("Number of registers", "length"),
        ("Quantity", "length"),
        ("寄存器数量", "length"),
        ("Byte order", "word order"),
        ("Bemerkung", "description"),
        ("备注", "description"),
        *((column, column) for column in COLUMNS),
    ],
)
def test_headings(heading, column):
    sheet = read(
        f"Name;Address;{heading}\na;1;\n" if column not in ("name", "address") else f"{heading};Unit;Address\n1;;1\n"
    )
    assert columns_of(sheet).has(column)


def test_cells_say_what_a_heading_leaves_open():
    function = columns_of(read("Function;Address\nphase voltage;1\ncurrent;2\n"))
    assert (function.heading("name"), function.has("function")) == ("Function", False)
    register = columns_of(read("Register;Address\nVoltage L1;1\nCurrent;2\n"))
    assert (register.heading("name"), register.heading("address")) == ("Register", "Address")
    area = columns_of(read("Name;Address;Type\na;1;Holding\nb;2;Input\n"))
    assert (area.heading("area"), area.has("type")) == ("Type", False)
    data = columns_of(read("Name;Address;Register type\na;1;U16\nb;2;float\n"))
    assert (data.heading("type"), data.has("area")) == ("Register type", False)


def test_the_better_of_two_columns_comes_first_and_the_other_fills_its_gaps():
    columns = columns_of(
        read("Address (hex);Address (dec);Documented name;Variable name\n10;16;Vpv1;\n11;17;Vpv2;pv-2\n")
    )
    assert columns.heading("address") == "Address (dec)"
    assert columns.cell(("10", "16", "Vpv1", ""), "name") == "Vpv1"
    assert columns.cell(("11", "17", "Vpv2", "pv-2"), "name") == "pv-2"


def test_columns_that_nobody_reads_are_named():
    assert columns_of(read("No.;Name;Address;Colour\n1;a;1;red\n")).unused == ["No.", "Colour"]
