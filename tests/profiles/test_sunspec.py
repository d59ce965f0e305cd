"""The walk along the models of a SunSpec device: what it asks, and where it ends."""

from struct import pack

import pytest

from gateway.modbus.pdu import parse_request
from gateway.profiles.sunspec import END, MOST_MODELS, Model, laid_out, walk


def registers(base, *models):
    """The registers of a device with such models, each a number and a length."""
    words, at = {base: 0x5375, base + 1: 0x6E53}, base + 2
    for number, length in models:
        words |= {at: number, at + 1: length}
        at += 2 + length
    return words


def played(words):
    """What is found of a device with such registers, and the addresses that were asked for."""
    steps, asked, answer = walk(), [], None
    try:
        pdu = next(steps)
        while True:
            span = parse_request(pdu).read
            assert (pdu[0], span.count) == (3, 2)
            asked.append(span.start)
            values = [words.get(span.start), words.get(span.start + 1)]
            answer = b"\x83\x02" if None in values else b"\x03\x04" + pack(">HH", *values)
            pdu = steps.send(answer)
    except StopIteration as end:
        return end.value, asked


def test_a_device_without_the_marker_is_asked_at_three_addresses_only():
    assert played({}) == ((), [40000, 50000, 0])


@pytest.mark.parametrize("base", [40000, 50000, 0])
def test_each_model_is_found_at_its_address(base):
    found, asked = played(registers(base, (1, 66), (103, 50), (120, 26), (END, 0)))
    assert found == (Model(1, base + 2, 66), Model(103, base + 70, 50), Model(120, base + 122, 26))
    assert asked[-4:] == [base + 2, base + 70, base + 122, base + 150]


def test_a_device_that_does_not_answer_ends_the_walk_with_what_was_found():
    assert played(registers(40000, (1, 65), (101, 50)))[0] == (Model(1, 40002, 65), Model(101, 40069, 50))


@pytest.mark.parametrize("header", [(0, 10), (END, 10), (103, 0), (103, 25500)])
def test_a_header_that_cannot_be_one_ends_the_walk(header):
    assert played(registers(40000, (1, 66), header))[0] == (Model(1, 40002, 66),)


def test_a_chain_has_an_end():
    endless = dict.fromkeys(range(40002, 41000), 1) | registers(40000)
    found, asked = played(endless)
    assert (len(found), len(asked)) == (MOST_MODELS, MOST_MODELS + 1)


def test_silence_is_no_marker():
    steps = walk()
    next(steps)
    steps.send(None)
    steps.send(None)
    with pytest.raises(StopIteration) as end:
        steps.send(None)
    assert end.value.value == ()


@pytest.mark.parametrize(
    ("points", "addresses"),
    [
        ((40004, 40072), (40002, 40070, 40122)),
        ((40004, 40071, 40120), (40002, 40069, 40121)),  # model 1 has 65 registers there
        ((50072,), (50002, 50070, 50122)),
        ((72, 4), (2, 70, 122)),
        ((), (40002, 40070, 40122)),
    ],
)
def test_models_are_laid_out_around_the_points(points, addresses):
    assert tuple(model.address for model in laid_out((1, 103, 160), points)) == addresses


def test_registers_of_models_whose_length_differs_between_devices_are_assumed():
    assert [model.address for model in laid_out((1, 64001, 64002), ())] == [40002, 40070, 40122]
