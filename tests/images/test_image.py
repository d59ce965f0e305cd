"""What an image is besides its functions: limits, profiles, ranges, broadcasts, counts."""

import pytest

from gateway.images.image import ImageCounts
from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile
from images.asking import GENERIC, MINT, ask, broadcast, contents, exchange, image


@pytest.fixture
def full():
    """Every address of every area."""
    everything = ((0, 65535),)
    return image(coils=everything, discrete=everything, input=everything, holding=everything)


def test_the_functions_of_an_image(full):
    answered = {function for function in range(1, 128) if exchange(full, bytes((function,)))[-1] != 1}
    assert answered == {1, 2, 3, 4, 5, 6, 8, 11, 12, 15, 16, 17, 22, 23, 43}


@pytest.mark.parametrize(
    ("function", "most", "one", "all_of_them"),
    [(1, 2000, 1, 250), (2, 2000, 1, 250), (3, 125, 2, 250), (4, 125, 2, 250)],
)
def test_the_quantity_of_a_read_is_bounded(full, function, most, one, all_of_them):
    def read(quantity: int) -> bytes:
        return exchange(full, bytes((function, 0, 0)) + quantity.to_bytes(2, "big"))

    assert read(1) == bytes((function, one)) + bytes(one)
    assert read(most) == bytes((function, all_of_them)) + bytes(all_of_them)
    for wrong in (0, most + 1, 0xFFFF):
        assert read(wrong) == bytes((function | 0x80, 3))


def test_at_most_1968_coils_are_written_at_once(full):
    ones = "FF" * 246
    assert ask(full, f"0F 0001 07B0 F6 {ones}") == "0F 00 01 07 B0"
    assert full.tables[Area.COILS].values(0, 1970) == (0, *[1] * 1968, 0)
    assert ask(full, f"0F 0000 07B1 F7 {ones}FF") == "8F 03"
    assert ask(full, "0F 0000 0000 00") == "8F 03"
    assert full.tables[Area.COILS].values(0, 1) == (0,)


def test_at_most_123_registers_are_written_at_once(full):
    values = "".join(f"{value:04X}" for value in range(1, 125))
    assert ask(full, f"10 0001 007B F6 {values[:492]}") == "10 00 01 00 7B"
    assert full.tables[Area.HOLDING].values(0, 125) == (0, *range(1, 124), 0)
    assert ask(full, f"10 0000 007C F8 {values}") == "90 03"
    assert ask(full, "10 0000 0000 00") == "90 03"
    assert full.tables[Area.HOLDING].values(0, 1) == (0,)


def test_function_23_reads_at_most_125_registers_and_writes_121(full):
    values = "ABCD" * 121
    assert ask(full, f"17 0079 007D 0000 0079 F2 {values}") == bytes.fromhex("17 FA" + "00" * 250).hex(" ").upper()
    assert full.tables[Area.HOLDING].values(0, 122) == (*[0xABCD] * 121, 0)
    assert ask(full, "17 0000 007E 0000 0001 02 0001") == "97 03"
    assert ask(full, f"17 0000 0001 0000 007A F4 {values} 0001") == "97 03"
    assert full.tables[Area.HOLDING].values(0, 1) == (0xABCD,)


def test_the_last_address_of_all(full):
    assert ask(full, "06 FFFF BEEF") == "06 FF FF BE EF"
    assert ask(full, "03 FFFF 0001") == "03 02 BE EF"
    assert ask(full, "05 FFFF FF00") == "05 FF FF FF 00"
    assert ask(full, "01 FFFE 0002") == "01 01 02"
    assert ask(full, "03 FFFF 0002") == "83 02"
    assert ask(full, "0F FFFF 0002 01 00") == "8F 02"
    assert ask(full, "17 0000 0001 FFFF 0002 04 0000 0000") == "97 02"


def test_an_image_without_items_knows_its_functions_but_no_address():
    empty = image()
    assert ask(empty, "01 0000 0001") == "81 02"
    assert ask(empty, "06 0000 0001") == "86 02"
    assert ask(empty, "03 0000 0000") == "83 03"


def test_the_tables_are_apart():
    four = image(coils=((0, 0),), discrete=((0, 0),), input=((0, 0),), holding=((0, 0),))
    ask(four, "05 0000 FF00")
    ask(four, "06 0000 BEEF")
    assert contents(four) == {
        Area.COILS: [(1,)],
        Area.DISCRETE: [(0,)],
        Area.INPUT: [(0,)],
        Area.HOLDING: [(0xBEEF,)],
    }


def test_a_hole_between_ranges_does_not_exist():
    sparse = image(holding=((1, 9), (100, 109)), initial={Area.HOLDING: ((9, (7,)), (100, (8,)))})
    assert ask(sparse, "03 0009 0001") == "03 02 00 07"
    assert ask(sparse, "03 0064 0001") == "03 02 00 08"
    assert ask(sparse, "03 0000 0001") == "83 02"
    assert ask(sparse, "03 0009 0002") == "83 02"
    assert ask(sparse, "03 0009 005C") == "83 02"
    assert ask(sparse, "06 0063 0001") == "86 02"
    assert ask(sparse, "17 0009 0001 0064 0001 02 BEEF") == "17 02 00 07"
    assert contents(sparse)[Area.HOLDING] == [(0,) * 8 + (7,), (0xBEEF,) + (0,) * 9]


# --- profiles -------------------------------------------------------------------------------------


@pytest.fixture
def mint():
    return image(MINT, coils=((0, 15),), discrete=((0, 15),), holding=((1, 99),))


def test_mint_has_its_six_functions_only(mint):
    assert ask(mint, "01 0000 0010") == "01 02 00 00"
    assert ask(mint, "02 0000 0010") == "02 02 00 00"
    assert ask(mint, "03 0001 0001") == "03 02 00 00"
    assert ask(mint, "05 0000 FF00") == "05 00 00 FF 00"
    assert ask(mint, "10 0001 0001 02 0001") == "10 00 01 00 01"
    assert ask(mint, "17 0001 0001 0001 0001 02 0002") == "17 02 00 02"
    assert ask(mint, "04 0001 0001") == "84 01"
    assert ask(mint, "06 0001 0001") == "86 01"
    assert ask(mint, "0F 0000 0001 01 01") == "8F 01"
    assert ask(mint, "16 0001 0000 0000") == "96 01"
    for pdu in ("08 0000 0000", "0B", "0C", "11", "2B 0E 01 00"):
        assert ask(mint, pdu) == f"{int(pdu[:2], 16) | 0x80:02X} 01"


def test_mint_has_registers_1_to_99(mint):
    assert ask(mint, "03 0000 0001") == "83 02"
    assert ask(mint, "10 0000 0001 02 0001") == "90 02"
    assert exchange(mint, bytes.fromhex("03 0001 0063")) == bytes.fromhex("03 C6" + "00" * 198)
    assert ask(mint, "03 0063 0001") == "03 02 00 00"
    assert ask(mint, "03 0063 0002") == "83 02"
    assert ask(mint, "17 0001 0001 0000 0001 02 0001") == "97 02"
    assert ask(mint, "17 0000 0001 0001 0001 02 0001") == "97 02"
    assert contents(mint)[Area.HOLDING] == [(0,) * 99]


def test_mint_reads_at_most_99_registers_even_at_a_wrong_address(mint):
    assert ask(mint, "03 0001 0064") == "83 03"
    assert ask(mint, "03 0000 0064") == "83 03"


def test_mint_leaves_a_coil_untouched_by_a_value_that_is_neither_on_nor_off(mint):
    ask(mint, "05 0003 FF00")
    assert ask(mint, "05 0003 0001") == "85 03"
    assert mint.tables[Area.COILS].values(3, 1) == (1,)


def test_mint_acts_on_broadcasts_of_05_and_16_only(mint):
    broadcast(mint, "05 0002 FF00")
    broadcast(mint, "10 0001 0001 02 BEEF")
    assert mint.tables[Area.COILS].values(2, 1) == (1,)
    assert mint.tables[Area.HOLDING].values(1, 2) == (0xBEEF, 0)
    broadcast(mint, "06 0002 0001")
    broadcast(mint, "0F 0000 0008 01 00")
    broadcast(mint, "16 0001 0000 0000")
    broadcast(mint, "17 0001 0001 0001 0001 02 0000")
    assert mint.tables[Area.COILS].values(2, 1) == (1,)
    assert mint.tables[Area.HOLDING].values(1, 2) == (0xBEEF, 0)


def test_an_address_must_exist_in_the_profile_and_in_the_image():
    narrow = image(MINT, holding=((0, 9), (95, 199)))
    assert ask(narrow, "03 0001 0009") == "03 12" + " 00" * 18
    assert ask(narrow, "03 0000 0001") == "83 02"
    assert ask(narrow, "03 000A 0001") == "83 02"
    assert ask(narrow, "03 0063 0001") == "03 02 00 00"
    assert ask(narrow, "03 0064 0001") == "83 02"


def test_a_profile_cannot_add_functions():
    chatty = image(Profile("chatty", functions=frozenset({3, 7, 65})), holding=((0, 0),))
    assert ask(chatty, "07") == "87 01"
    assert ask(chatty, "41") == "C1 01"


def test_a_profile_rules_over_the_functions_without_items_too():
    quiet = image(Profile("quiet", functions=frozenset({3, 43})))
    assert ask(quiet, "2B 0E 04 00").startswith("2B 0E 04")
    for pdu in ("08 0000 A537", "0B", "0C", "11"):
        assert ask(quiet, pdu).endswith(" 01")


# --- broadcasts -----------------------------------------------------------------------------------


def test_a_broadcast_writes():
    plain = image(coils=((0, 7),), holding=((0, 3),))
    broadcast(plain, "05 0000 FF00")
    broadcast(plain, "0F 0004 0002 01 03")
    broadcast(plain, "06 0000 1234")
    broadcast(plain, "10 0001 0002 04 0001 0002")
    broadcast(plain, "16 0000 FF00 00FF")
    assert contents(plain)[Area.COILS] == [(1, 0, 0, 0, 1, 1, 0, 0)]
    assert contents(plain)[Area.HOLDING] == [(0x12FF, 1, 2, 0)]


@pytest.mark.parametrize(
    "pdu",
    [
        "03 0000 0001",
        "17 0000 0001 0000 0001 02 BEEF",
        "05 0000 1234",
        "06 0004 0001",
        "10 0003 0002 04 0001 0002",
        "10 0000 0001",
        "00",
        "90 0000 0001 02 0001",
    ],
)
def test_a_broadcast_that_cannot_be_acted_on_is_ignored(pdu):
    plain = image(coils=((0, 7),), holding=((0, 3),))
    before = contents(plain)
    broadcast(plain, pdu)
    assert contents(plain) == before


# --- what operators see ---------------------------------------------------------------------------


def test_requests_and_exceptions_are_counted():
    counted = image(GENERIC, holding=((0, 3),))
    ask(counted, "03 0000 0001")
    ask(counted, "03 0004 0001")
    ask(counted, "63")
    assert counted.counts == ImageCounts(requests=3, exceptions=2)


def test_the_repr_is_a_status_line():
    counted = image(holding=((0, 3),))
    ask(counted, "03 0004 0001")
    assert repr(counted) == "<Image shift-data unit=10 requests=1 exceptions=1>"


def test_an_image_has_no_registers_of_four_bytes() -> None:
    enron = image(Profile("enron", wide={Area.HOLDING: ((0, 9),)}), holding=((0, 9),))
    assert ask(enron, "03 0000 0002") == "03 04 00 00 00 00"
    assert ask(enron, "10 0000 0001 04 01020304") == "90 03"
