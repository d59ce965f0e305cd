"""What a device refuses by its profile, before anything goes on the line."""

import pytest

from gateway.devices.device import SiteDevice
from gateway.modbus.codes import Area
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from kit.line_bench import Bench

MINT = Profile("mint", functions=frozenset({1, 2, 3, 5, 16, 23}), limits={3: 99}, areas={Area.HOLDING: ((1, 99),)})


@pytest.mark.parametrize(
    ("pdu", "answer"),
    [
        pytest.param("04 00 01 00 01", "84 01", id="a function the profile does not name"),
        pytest.param("03 00 01 00 64", "83 03", id="more items than the profile allows"),
        pytest.param("03 00 00 00 01", "83 02", id="register 0, which does not exist"),
        pytest.param("03 00 63 00 02", "83 02", id="beyond the last register"),
        pytest.param("05 00 00 12 34", "85 03", id="a coil value that is neither on nor off"),
        pytest.param("17 00 01 00 01 00 64 00 01 02 00 00", "97 02", id="FC23 that writes outside"),
    ],
)
def test_a_profile_refuses_before_the_line(pdu: str, answer: str) -> None:
    bench = Bench()
    bench.device(profile=MINT).submit(bench.client.ask(pdu, now=bench.now), bench.now)
    assert bench.client.answers == [answer]
    assert bench.written == []


def test_what_the_profile_admits_is_sent() -> None:
    bench = Bench()
    bench.device(profile=MINT).submit(bench.client.ask("03 00 01 00 63", now=bench.now), bench.now)
    assert len(bench.written) == 1


@pytest.mark.parametrize(
    ("functions", "sent"),
    [
        pytest.param(None, ["03 00 08 00 01"], id="a profile without functions does not name 22"),
        pytest.param({3, 16, 22}, ["16 00 08 FF EF 00 10"], id="22 is passed on where the profile names it"),
    ],
)
def test_bits_are_written_with_22_or_after_a_read(functions: set[int] | None, sent: list[str]) -> None:
    bench = Bench()
    bench.device(profile=Profile("any", functions=None if functions is None else frozenset(functions)))
    bench.ask("16 00 08 FF EF 00 10", in_one_turn=6)
    assert [written[3:-6] for written in bench.written] == sent


@pytest.mark.parametrize(
    ("profile", "answer"),
    [
        pytest.param(Profile("reads", functions=frozenset({3})), "96 01", id="it cannot be written"),
        pytest.param(Profile("few", areas={Area.HOLDING: ((0, 7),)}), "96 02", id="no such register"),
    ],
)
def test_bits_are_refused_where_the_register_cannot_be_read_and_written(profile: Profile, answer: str) -> None:
    bench = Bench()
    bench.device(profile=profile)
    bench.ask("16 00 08 FF EF 00 10", in_one_turn=6)
    assert bench.client.answers == [answer]
    assert bench.written == []


def test_beside_a_guarded_value_bits_are_written_after_a_read_even_with_22() -> None:
    bench = Bench()
    mode = Point("mode", Area.HOLDING, 8, bits=(0, 2), write="yes", maximum=5)
    bench.device(profile=Profile("any", functions=frozenset({3, 6, 22})).guarding([mode]))
    bench.ask("16 00 08 FF EF 00 10", in_one_turn=6)
    bench.respond("03 02 00 05")
    assert [written[3:-6] for written in bench.written] == ["03 00 08 00 01"]
    bench.pass_time(0.1)
    assert [written[3:-6] for written in bench.written] == ["03 00 08 00 01", "06 00 08 00 15"]
    bench.respond("06 00 08 00 15")
    assert bench.client.answers == ["16 00 08 FF EF 00 10"]


@pytest.mark.parametrize(
    ("pdu", "read"),
    [
        pytest.param("16 00 08 FF EF 00 10", "03 02 00 06", id="the device itself is beyond the limit"),
        pytest.param("16 00 08 FF F8 00 06", None, id="the value is beyond the limit"),
        pytest.param("16 00 08 FF FE 00 00", None, id="a part of the value"),
    ],
)
def test_a_turn_that_would_break_a_guard_writes_nothing(pdu: str, read: str | None) -> None:
    bench = Bench()
    mode = Point("mode", Area.HOLDING, 8, bits=(0, 2), write="yes", maximum=5)
    bench.device(profile=Profile("any").guarding([mode]))
    bench.ask(pdu, in_one_turn=6)
    if read is not None:
        bench.respond(read)
    bench.pass_time(5.0)
    assert bench.client.answers == ["96 03"]
    assert len(bench.written) == (0 if read is None else 1)
    assert bench.counts.refused == 1
    assert bench.asks("03 00 10 00 01") is not None, "the line goes on"


def test_bits_of_another_site_beside_a_guarded_value_are_not_written_even_with_22() -> None:
    bench = Bench()
    mode = Point("mode", Area.HOLDING, 8, bits=(0, 2), write="yes", maximum=5)
    profile = Profile("any", functions=frozenset({3, 6, 22})).guarding([mode])
    bench.devices[1] = SiteDevice(bench.device(profile=profile).settings, bench.line)
    bench.ask("16 00 08 FF EF 00 10", in_one_turn=6)
    assert bench.client.answers == ["96 04"]
    assert bench.written == []


def test_bits_of_another_site_are_written_with_22_only() -> None:
    """Its gateway has clients of its own, which could write between."""
    bench = Bench()
    for functions, answers in ((None, ["96 04"]), (frozenset({3, 6, 22}), [])):
        settings = bench.device(profile=Profile("any", functions=functions)).settings
        bench.devices[1] = SiteDevice(settings, bench.line)
        bench.client.answers.clear()
        bench.ask("16 00 08 FF EF 00 10", in_one_turn=6)
        assert bench.client.answers == answers
    assert len(bench.written) == 1
