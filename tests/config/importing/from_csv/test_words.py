"""What manuals call types, word orders, areas, functions and access."""

import pytest

from gateway.config.importing.from_csv.words import access_of, area_of, functions_of, swap_of, type_of
from gateway.registers.datatypes import DATA_TYPES, SWAPS


@pytest.mark.parametrize(
    ("cells", "kind", "bits"),
    [
        ("U16; UINT16; uint 16; Unsigned 16 bit; unsigned int16; INT16U; uint_16; 无符号16位", "uint", 16),
        ("uint; unsigned; WORD; ushort; unsigned short; UINT; enum; bitfield; Bitmap; hex; status", "uint", None),
        ("S16; INT16; I16; signed 16; INT16S; int_16; 16 bit signed integer; 有符号16位", "int", 16),
        ("int; INT; signed; short; Integer; 整型", "int", None),
        ("U32; UINT32; unsigned 32-bit integer; uint32_t; enum32; bitfield32; acc32; U_DWORD; int32u", "uint", 32),
        ("DWORD; UDINT; unsigned long; ULONG", "uint", 32),
        ("S32; INT32; I32; signed int 32; S_DWORD", "int", 32),
        ("DINT; long; signed long", "int", 32),
        ("U64; UINT64; ULINT; QWORD; unsigned long long; acc64", "uint", 64),
        ("S64; INT64; LINT; long long", "int", 64),
        ("float; REAL; single; IEEE754; IEEE 754 float; 浮点数; Gleitkomma", "float", None),
        ("float32; F32; FP32; 32-bit float; float (32 bit); REAL32; 4 byte float", "float", 32),
        ("float64; double; LREAL; F64", "float", 64),
        ("U8; uint8; byte; USINT; unsigned char; 1 byte unsigned", "uint", 8),
        ("S8; int8; SINT; signed char", "int", 8),
        ("BCD16; 16 bit BCD", "bcd", 16),
        ("BCD32", "bcd", 32),
        ("bool; BOOLEAN; bit; 1bit; coil; 布尔", "bool", None),
        ("sunssf", "int", 16),
    ],
)
def test_types(cells, kind, bits):
    for cell in cells.split("; "):
        found = type_of(cell)
        assert found is not None, cell
        assert (found.kind, found.bits if kind != "bool" else None) == (kind, bits), cell


@pytest.mark.parametrize(
    ("cell", "characters"),
    [
        ("string", None),
        ("STR", None),
        ("ASCII", None),
        ("string(10)", 10),
        ("char[16]", 16),
        ("ASCII 20", 20),
        ("utf-8", None),
    ],
)
def test_text(cell, characters):
    assert (type_of(cell).kind, type_of(cell).characters) == ("string", characters)


@pytest.mark.parametrize("cell", ["", "voltage", "?", "see note", "42"])
def test_what_is_no_type(cell):
    assert type_of(cell) is None


def test_our_own_types_and_swaps_are_what_they_are():
    for name in DATA_TYPES:
        found = type_of(name)
        kind = {"bit": "bool"}.get(name, name.rstrip("0123456789"))
        assert found.kind == kind
        assert kind in ("bool", "string") or f"{found.kind}{found.bits}" == name
        assert found.swap is None
    assert [swap_of(swap, "word order") for swap in SWAPS] == list(SWAPS)


@pytest.mark.parametrize(
    ("cell", "swap"),
    [
        ("float32 ABCD", "none"),
        ("UINT32 (CDAB)", "words"),
        ("FP32_R", "words"),
        ("int32 swapped", "words"),
        ("U32", None),
    ],
)
def test_a_type_may_name_its_order(cell, swap):
    assert type_of(cell).swap == swap


@pytest.mark.parametrize(
    ("heading", "cell", "swap"),
    [
        ("Word order", "ABCD", "none"),
        ("Word order", "CD AB", "words"),
        ("Order", "BADC", "bytes"),
        ("Order", "DC-BA", "both"),
        ("Order", "3-4-1-2", "words"),
        ("Endianness", "GHEFCDAB", "words"),
        ("Swap", "word", "words"),
        ("Swap", "byte", "bytes"),
        ("Swap", "word_byte", "both"),
        ("Swap", "none", "none"),
        ("Word swap", "yes", "words"),
        ("Word swap", "no", "none"),
        ("Byte swap", "yes", "bytes"),
        ("Word order", "LSW first", "words"),
        ("Word order", "low word first", "words"),
        ("Word order", "MSW first", "none"),
        ("Word order", "little endian", "words"),
        ("Endianness", "little endian", "both"),
        ("Byte order", "little endian", "both"),
        ("Endian", "Big Endian", "none"),
        ("Endian", "Big-endian byte swap", "bytes"),
        ("Endian", "Little-endian byte swap", "words"),
        ("字节序", "大端", "none"),
        ("Order", "whatever", None),
    ],
)
def test_word_orders(heading, cell, swap):
    assert swap_of(cell, heading) == swap


@pytest.mark.parametrize(
    ("cells", "area"),
    [
        ("holding; Holding Register; HR; 4x; 4xxxx; Halteregister; 保持寄存器; FC3", "holding"),
        ("input; Input Registers; IR; 3x; analog input; Eingangsregister; 输入寄存器; FC04", "input"),
        ("coil; Coils; DO; 0x; relay output; Spule; 线圈; FC01", "coils"),
        ("discrete; Discrete Input; digital input; DI; 1x; 离散输入; fc2", "discrete"),
        ("3; 4; RW; register; ?", None),
    ],
)
def test_areas(cells, area):
    assert {area_of(cell) for cell in cells.split("; ")} == {area}


@pytest.mark.parametrize(
    ("cell", "functions"),
    [
        ("3", {3}),
        ("03", {3}),
        ("0x03", {3}),
        ("03H/06H/10H", {3, 6, 16}),
        ("3, 6, 16", {3, 6, 16}),
        ("FC04", {4}),
        ("R:03 W:06/10", {3, 6, 16}),
        ("01/05/0F", set()),
        ("01H/05H/0FH", {1, 5, 15}),
        ("Read", set()),
        ("phase voltage", set()),
        ("43", set()),
        ("", set()),
    ],
)
def test_functions(cell, functions):
    assert functions_of(cell) == functions


@pytest.mark.parametrize(
    ("cells", "writing"),
    [
        ("R; RO; r; Read; read only; Read-Only; no; lesen; 只读", "no"),
        ("RW; R/W; r-w; Read/Write; read and write; yes; lesen/schreiben; 读写; Write", "yes"),
        ("W; WO; write only; 只写", "only"),
        ("?; maybe", None),
    ],
)
def test_access(cells, writing):
    assert {access_of(cell) for cell in cells.split("; ")} == {writing}
