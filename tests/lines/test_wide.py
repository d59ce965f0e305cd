"""Registers of four bytes on the way: responses twice as long, and writes of four bytes each."""

import pytest

from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile
from kit.asker import Asker
from kit.line_bench import ASCII, Bench

ENRON = Profile("enron", wide={Area.HOLDING: ((5000, 5999),)})
#: Two registers from 5000 on.
READ = "03 13 88 00 02"
RESPONSE = "03 08 00 01 02 03 04 05 06 07"
WRITE = "10 13 88 00 01 04 DE AD BE EF"


def bench(**settings: object) -> Bench:
    made = Bench(**settings)
    made.device(profile=ENRON)
    return made


@pytest.mark.parametrize("settings", [{}, {"timing": ASCII}], ids=["rtu", "ascii"])
def test_a_read_gets_four_bytes_a_register(settings: dict[str, object]) -> None:
    line = bench(**settings)
    line.ask(READ)
    line.respond(RESPONSE)
    assert line.client.answers == [RESPONSE]


def test_it_may_come_in_pieces() -> None:
    line = bench()
    line.ask(READ)
    frame = line.frame(1, RESPONSE).split()
    for at in range(0, len(frame), 3):
        line.hear(" ".join(frame[at : at + 3]))
    assert line.client.answers == [RESPONSE]


def test_a_response_with_two_bytes_a_register_is_none() -> None:
    line = bench()
    line.ask(READ)
    line.respond("03 04 00 01 02 03")
    line.pass_time(1.0)
    assert line.client.answers == ["83 0B"]


def test_other_registers_have_two_bytes() -> None:
    line = bench()
    line.ask("03 00 00 00 02")
    line.respond("03 04 00 01 02 03")
    assert line.client.answers == ["03 04 00 01 02 03"]


def test_a_write_has_four_bytes_a_register() -> None:
    line = bench()
    line.ask(WRITE)
    assert line.written == [line.frame(1, WRITE)]
    line.respond("10 13 88 00 01")
    assert line.client.answers == ["10 13 88 00 01"]


def test_the_longest_response_has_its_time_on_the_wire() -> None:
    """A response of 248 bytes of data takes longer than one of 124."""
    long, short = bench(), Bench()
    for each in (long, short):
        each.ask("03 13 88 00 3E")
    assert long.line.deadline() - short.line.deadline() == pytest.approx(124 * long.settings.timing.character)


def test_a_late_response_is_not_that_to_the_next_read() -> None:
    line = bench()
    line.ask(READ)
    line.pass_time(0.3)
    line.ask(READ)
    line.respond(RESPONSE)
    line.ask(READ)
    line.pass_time(0.02)
    line.respond(RESPONSE.replace("07", "08"))
    assert line.client.answers == ["83 0B", "83 0B", RESPONSE.replace("07", "08")]


def test_the_same_read_of_another_device_has_two_bytes() -> None:
    line = bench()
    line.device(2)
    line.ask(READ)
    line.respond(RESPONSE)
    line.pass_time(0.02)
    line.ask(READ, 2)
    line.respond("03 04 00 01 02 03", unit=2)
    assert line.client.answers == [RESPONSE, "03 04 00 01 02 03"]


def test_equal_reads_share_it() -> None:
    line, other = bench(), Asker("10.0.0.8:1", host="10.0.0.8")
    line.ask("03 00 00 00 01")
    line.ask(READ)
    line.ask(READ, client=other)
    line.respond("03 02 00 00")
    line.pass_time(0.02)
    line.respond(RESPONSE)
    assert (line.client.answers, other.answers) == (["03 02 00 00", RESPONSE], [RESPONSE])
