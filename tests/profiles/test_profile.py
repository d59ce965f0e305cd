import pytest

from gateway.errors import IllegalAddress, IllegalFunction, IllegalValue, RequestError
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span, parse_request
from gateway.profiles.profile import Profile, covers
from kit.vectors import malformed

MINT = Profile(
    name="mint",
    functions=frozenset({1, 2, 3, 5, 16, 23}),
    limits={3: 99},
    areas={Area.HOLDING: ((1, 99),)},
)
ANY = Profile(name="generic")


@pytest.mark.parametrize(
    "pdu",
    [
        pytest.param("03 00 01 00 63", id="all 99 registers"),
        pytest.param("10 00 63 00 01 02 00 00", id="the last register"),
        pytest.param("17 00 01 00 63 00 01 00 01 02 00 00", id="read all, write one"),
        pytest.param("01 FF 00 00 10", id="an area that is not named is open"),
    ],
)
def test_what_the_device_accepts_is_parsed(pdu):
    assert MINT.check(bytes.fromhex(pdu)) == parse_request(bytes.fromhex(pdu))


@pytest.mark.parametrize(
    ("pdu", "error"),
    [
        pytest.param("06 00 01 00 00", IllegalFunction, id="a function it does not have"),
        pytest.param("41", IllegalFunction, id="an unknown function it does not have"),
        pytest.param("03 00 01 00 64", IllegalValue, id="more registers than it allows"),
        pytest.param("03 00 00 00 01", IllegalAddress, id="register 0"),
        pytest.param("03 00 63 00 02", IllegalAddress, id="beyond the last register"),
        pytest.param("10 00 00 00 01 02 00 00", IllegalAddress, id="write register 0"),
        pytest.param("17 00 01 00 01 00 64 00 01 02 00 00", IllegalAddress, id="write behind a good read"),
        pytest.param("17 00 64 00 01 00 01 00 01 02 00 00", IllegalAddress, id="read before a good write"),
    ],
)
def test_what_the_device_does_not_accept_is_refused(pdu, error):
    with pytest.raises(error):
        MINT.check(bytes.fromhex(pdu))


@pytest.mark.parametrize(
    ("pdu", "error"),
    [
        pytest.param("06 00 00 00", IllegalFunction, id="function before length"),
        pytest.param("03 00 00 00 64", IllegalValue, id="quantity before address"),
        pytest.param("03 00 00 00", IllegalValue, id="length before address"),
    ],
)
def test_the_order_of_checks_is_function_structure_address(pdu, error):
    with pytest.raises(error):
        MINT.check(bytes.fromhex(pdu))


@pytest.mark.parametrize(("pdu", "error"), [pytest.param(*row[1:], id=row[0]) for row in malformed()])
def test_no_profile_lets_a_malformed_request_pass(pdu, error):
    with pytest.raises(RequestError) as refused:
        ANY.check(pdu)
    assert type(refused.value).__name__ == error


def test_a_profile_without_rules_lets_every_function_pass():
    for function in range(1, 128):
        assert ANY.knows(function)
    assert ANY.check(b"\x41\x01\x02").function == 0x41


@pytest.mark.parametrize("value", ["FF00", "0000", "5500", "0007", "FFFF"])
def test_with_any_coil_function_05_may_have_any_value_and_is_confirmed_with_it(value):
    pdu = bytes.fromhex(f"05 0102 {value}")
    asked = Profile("relays", any_coil=True).check(pdu)
    assert asked.write == Span(Area.COILS, 0x0102, 1)
    assert asked.accepts(pdu)
    assert not asked.accepts(bytes.fromhex("05 0102 1234"))


@pytest.mark.parametrize("pdu", ["05 0102 55", "05 0102 5500 00", "0F 0001 0008 02 00", "06 0001"])
def test_with_any_coil_all_else_is_checked(pdu):
    with pytest.raises(IllegalValue):
        Profile("relays", any_coil=True).check(bytes.fromhex(pdu))


def test_with_any_coil_functions_and_addresses_are_checked():
    pdu = bytes.fromhex("05 0008 5500")
    with pytest.raises(IllegalFunction):
        Profile("relays", functions=frozenset({1}), any_coil=True).check(pdu)
    with pytest.raises(IllegalAddress):
        Profile("relays", areas={Area.COILS: ((0, 7),)}, any_coil=True).check(pdu)


def test_broadcasts_are_the_functions_that_can_be_broadcast_and_the_device_knows():
    assert Profile("any").broadcasts == {5, 6, 15, 16, 22}
    assert Profile("mint", functions=frozenset({1, 2, 3, 5, 16, 23})).broadcasts == {5, 16}


def test_a_refusal_names_the_profile_and_the_rule():
    with pytest.raises(IllegalFunction, match="profile mint has no function 6"):
        MINT.check(bytes.fromhex("06 00 01 00 00"))
    with pytest.raises(IllegalValue, match="profile mint allows 99 items of function 3"):
        MINT.check(bytes.fromhex("03 00 01 00 64"))
    with pytest.raises(IllegalAddress, match="profile mint has no holding 99-100"):
        MINT.check(bytes.fromhex("03 00 63 00 02"))


@pytest.mark.parametrize(
    ("start", "count", "inside"),
    [(0, 10, True), (9, 1, True), (9, 2, False), (10, 1, False), (20, 5, True), (5, 20, False), (24, 2, False)],
)
def test_a_span_must_lie_in_one_range(start, count, inside):
    assert covers(((0, 9), (20, 24)), Span(Area.COILS, start, count)) is inside


def test_no_ranges_are_no_bound_and_an_empty_area_has_no_address():
    assert covers(None, Span(Area.COILS, 65535, 1))
    assert not covers((), Span(Area.COILS, 0, 1))
