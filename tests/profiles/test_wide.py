"""Registers of four bytes (Enron): what a request for them looks like, and which there are."""

import pytest

from gateway.errors import IllegalAddress, IllegalFunction, IllegalValue, RequestError
from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile

ENRON = Profile("enron", wide={Area.HOLDING: ((5000, 5999), (7000, 7999)), Area.INPUT: ((0, 65535),)})
#: 5000, 5999, 6000, 7000 in hexadecimal.
FIRST, LAST, BEYOND, SECOND = "1388", "176F", "1770", "1B58"


def check(pdu: str) -> int | None:
    return ENRON.check(bytes.fromhex(pdu)).response_size


@pytest.mark.parametrize(
    ("pdu", "size"),
    [
        (f"03 {FIRST} 0001", 2 + 4),
        (f"03 {FIRST} 003E", 2 + 4 * 62),
        (f"03 {LAST} 0001", 2 + 4),
        (f"03 {BEYOND} 0001", 2 + 2),
        (f"03 {BEYOND} 007D", 2 + 250),
        ("04 0000 0002", 2 + 8),
        (f"10 {FIRST} 0002 08 0102030405060708", 5),
        (f"10 {BEYOND} 0002 04 01020304", 5),
        (f"06 {BEYOND} 0001", 5),
        ("01 1388 0010", 4),
    ],
)
def test_a_register_of_them_has_four_bytes(pdu: str, size: int) -> None:
    assert check(pdu) == size


@pytest.mark.parametrize(
    ("pdu", "error"),
    [
        pytest.param(f"03 {FIRST} 003F", IllegalValue, id="more than fit a response"),
        pytest.param(f"03 {FIRST} 0000", IllegalValue, id="none"),
        pytest.param(f"03 {FIRST} 00", IllegalValue, id="cut"),
        pytest.param(f"10 {FIRST} 0002 04 01020304", IllegalValue, id="two bytes a register"),
        pytest.param(f"10 {BEYOND} 0001 04 01020304", IllegalValue, id="four bytes for one that has two"),
        pytest.param(f"10 {FIRST} 003E F8 " + 248 * "00", IllegalValue, id="more than fit a request"),
        pytest.param(f"06 {FIRST} 0001", IllegalFunction, id="06"),
        pytest.param(f"16 {FIRST} 0001 0001", IllegalFunction, id="22"),
        pytest.param(f"17 {FIRST} 0001 0000 0001 02 0001", IllegalFunction, id="23 that reads some"),
        pytest.param(f"17 0000 0001 {FIRST} 0001 02 0001", IllegalFunction, id="23 that writes one"),
        pytest.param("03 1387 0002", IllegalAddress, id="one before them too"),
        pytest.param(f"03 {LAST} 0002", IllegalAddress, id="one after them too"),
        pytest.param(f"10 {LAST} 0002 08 0102030405060708", IllegalAddress, id="a write of one after them too"),
        pytest.param("03 1388 0FFF", IllegalAddress, id="both ranges, and what is between"),
    ],
)
def test_what_does_not_fit_is_refused(pdu: str, error: type[RequestError]) -> None:
    with pytest.raises(error):
        check(pdu)


def test_other_rules_of_the_profile_hold() -> None:
    profile = Profile("enron", functions=frozenset({3}), limits={3: 10}, wide=ENRON.wide)
    with pytest.raises(IllegalValue):
        profile.check(bytes.fromhex(f"03 {FIRST} 000B"))
    with pytest.raises(IllegalFunction):
        profile.check(bytes.fromhex(f"10 {FIRST} 0001 04 01020304"))


@pytest.mark.parametrize("function", [6, 16])
def test_their_bits_are_not_written(function: int) -> None:
    with pytest.raises((IllegalFunction, IllegalValue)):
        ENRON.check_in_one_turn(bytes.fromhex(f"16 {FIRST} FFFE 0001"), function)


def test_another_coil_value_is_still_only_for_05() -> None:
    profile = Profile("relays", any_coil=True)
    profile.check(bytes.fromhex("05 0000 1234"))
    with pytest.raises(IllegalValue):
        profile.check(bytes.fromhex("10 0000 0001 04 01020304"))
