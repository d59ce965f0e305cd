"""What a unit is asked to recognise its kind, and which kinds fit."""

from gateway.modbus.codes import Area
from gateway.profiles.identity import Identity, RegisterIdentity
from gateway.profiles.recognition import (
    MOST_REGISTERS,
    MOST_RESPONSES,
    MOST_UNANSWERED,
    KnownKind,
    Recognised,
    recognise,
)
from gateway.profiles.sunspec import laid_out

REFUSED = b"\x83\x02"
BASIC, REGULAR = "2B 0E 01 00", "2B 0E 02 03"
MARKERS = ["03 9C 40 00 02", "03 C3 50 00 02", "03 00 00 00 02"]


def text(name, fc43):
    return KnownKind(name, Identity(fc43=fc43))


def register(name, address, equals, area=Area.HOLDING):
    return KnownKind(name, Identity(register=RegisterIdentity(area, address, equals)))


def sunspec(name, *models):
    return KnownKind(name, Identity(sunspec=models), models=laid_out(models, ()))


def objects(*texts, first=0, level=0x81, more=0, following=0):
    data = b"".join(bytes((first + index, len(each))) + each for index, each in enumerate(texts))
    return bytes((0x2B, 0x0E, 1, level, more, following, len(texts))) + data


def played(kinds, answers):
    """What is recognised, and what was asked; `answers` by question in hex, the others are silence."""
    steps, asked = recognise(kinds), []
    try:
        pdu = next(steps)
        while True:
            asked.append(pdu.hex(" ").upper())
            pdu = steps.send(answers.get(asked[-1]))
    except StopIteration as end:
        return end.value, asked


def test_where_no_kind_is_known_nothing_is_asked():
    assert played([], {}) == (Recognised(), [])


def test_a_text_of_the_identification_tells_the_kind_with_one_question():
    kinds = [text("a", "B23"), text("b", "B24"), register("c", 0, 1), sunspec("d", 1, 103)]
    found, asked = played(kinds, {BASIC: objects(b"Maker", b"B24 112-100\0", b"1.2")})
    assert found.names == ("b",)
    assert asked == [BASIC]


def test_the_longest_text_that_fits_counts_and_those_that_cannot_be_told_apart_are_all_named():
    kinds = [text("a", "EM"), text("b", "EM340"), text("c", "EM340")]
    assert played(kinds, {BASIC: objects(b"", b"EM340-X")})[0].names == ("b", "c")


def test_objects_that_do_not_fit_into_one_response_are_asked_for_on():
    answers = {BASIC: objects(b"Maker", more=0xFF, following=1), "2B 0E 01 01": objects(b"B23", first=1)}
    assert played([text("a", "B23")], answers) == (Recognised(("a",)), [BASIC, "2B 0E 01 01"])


def test_regular_objects_are_asked_for_where_the_device_has_them_and_the_basic_ones_tell_nothing():
    answers = {BASIC: objects(b"Maker", level=0x82), REGULAR: objects(b"http", b"Meter", b"M-1", first=3)}
    assert played([text("a", "M-1")], answers) == (Recognised(("a",)), [BASIC, REGULAR])


def test_a_device_with_basic_objects_only_is_not_asked_for_others():
    found, asked = played([text("a", "B23")], {BASIC: objects(b"Maker", b"Other", b"1.0", level=0x81)})
    assert (found.names, asked) == ((), [BASIC, *MARKERS])


def test_identification_without_end_is_left():
    endless = {f"2B 0E 01 {at:02X}": objects(b"x", more=0xFF, following=at + 1) for at in range(255)}
    assert [question[:5] for question in played([text("a", "B23")], endless)[1]].count("2B 0E") == MOST_RESPONSES


def test_models_tell_the_kind_with_the_most_of_them_at_their_addresses():
    chain = {
        MARKERS[0]: b"\x03\x04SunS",
        "03 9C 42 00 02": bytes.fromhex("03 04 0001 0042"),
        "03 9C 86 00 02": bytes.fromhex("03 04 0067 0032"),
        "03 9C BA 00 02": bytes.fromhex("03 04 00A0 0030"),
        "03 9C EC 00 02": bytes.fromhex("03 04 FFFF 0000"),
    }
    kinds = [sunspec("a", 1, 103), sunspec("b", 1, 103, 160), sunspec("c", 1, 111), sunspec("d", 1, 160, 103)]
    found, _ = played(kinds, chain)
    assert found.names == ("b",)
    assert [(model.model, model.address) for model in found.models] == [(1, 40002), (103, 40070), (160, 40122)]


def test_models_for_other_numbers_of_phases_have_the_same_registers():
    chain = {
        MARKERS[0]: b"\x03\x04SunS",
        "03 9C 42 00 02": bytes.fromhex("03 04 0001 0042"),
        "03 9C 86 00 02": bytes.fromhex("03 04 0065 0032"),
    }
    found, _ = played([sunspec("a", 1, 103), sunspec("b", 1, 113)], chain)
    assert found.names == ("a",)


def test_models_at_other_addresses_are_no_device_of_that_kind():
    chain = {
        MARKERS[0]: b"\x03\x04SunS",
        "03 9C 42 00 02": bytes.fromhex("03 04 0001 0041"),
        "03 9C 85 00 02": bytes.fromhex("03 04 0067 0032"),
    }
    found, _ = played([sunspec("a", 1, 103)], chain)
    assert (found.names, len(found.models)) == ((), 2)


def test_a_register_is_asked_for_once_and_every_kind_that_fits_is_named():
    kinds = [register("a", 16, 1), register("b", 16, 2), register("c", 5, 7, Area.INPUT), register("d", 16, 2)]
    found, asked = played(kinds, {"03 00 10 00 01": b"\x03\x02\x00\x02", "04 00 05 00 01": b"\x84\x02"})
    assert (found.names, asked) == (("b", "d"), [*MARKERS, "03 00 10 00 01", "04 00 05 00 01"])


def test_a_register_tells_the_kind_of_a_device_with_models_that_no_kind_has():
    chain = {MARKERS[0]: b"\x03\x04SunS", "03 9C 42 00 02": bytes.fromhex("03 04 0067 0032")}
    found, _ = played([register("a", 40068, 103)], chain | {"03 9C 84 00 01": b"\x03\x02\x00\x67"})
    assert (found.names, [model.model for model in found.models]) == (("a",), [103])


def test_what_tells_nothing_leads_to_the_next_question():
    kinds = [text("a", "B23"), register("b", 16, 2), sunspec("c", 1, 103)]
    answers = {BASIC: b"\xab\x01", **dict.fromkeys(MARKERS, REFUSED), "03 00 10 00 01": b"\x03\x02\x00\x02"}
    assert played(kinds, answers) == (Recognised(("b",)), [BASIC, *MARKERS, "03 00 10 00 01"])


def test_a_silent_unit_is_not_asked_for_long():
    kinds = [text("t", "B23"), sunspec("s", 1, 103), *(register(f"k{at}", at, 1) for at in range(50))]
    assert len(played(kinds, {})[1]) == MOST_UNANSWERED


def test_there_is_a_limit_to_registers():
    kinds = [register(f"k{at}", at, 1) for at in range(50)]
    _, asked = played(kinds, {f"03 00 {at:02X} 00 01": REFUSED for at in range(50)})
    assert len(asked) == len(MARKERS) + MOST_REGISTERS
