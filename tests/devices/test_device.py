"""What a device refuses by its profile, before anything goes on the line."""

import pytest

from gateway.modbus.codes import Area
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
