"""Other clients on the line: when one of them has asked the same unit, the next response is nobody's for sure."""

import pytest

from gateway.events import ForeignFrame, OtherClientHeard
from gateway.lines.overheard import has_begun, overheard
from gateway.lines.quirks import LoneDevice
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.frame import Frame
from kit.line_bench import ASCII, READ, RESPONSE, TIMING, Bench

#: What another client asks, and its answer, which would fit our READ.
THEIRS = "03 00 30 00 01"
THEIR_RESPONSE = "03 02 DE AD"

ENCODE = {"rtu": rtu.encode, "ascii": ascii_framing.encode}


def adu(mode: str, unit: int, pdu: str) -> bytes:
    return ENCODE[mode](unit, bytes.fromhex(pdu))


@pytest.mark.parametrize("mode", ["rtu", "ascii"])
class TestOverheard:
    def heard(self, mode, *parts):
        data = b"".join(parts) + adu(mode, 1, RESPONSE)
        return overheard(mode, data, adu(mode, 1, READ), adu(mode, 1, RESPONSE))

    def test_nothing(self, mode):
        assert self.heard(mode) == (heard := type(self.heard(mode))(-1, (), (), has_noise=False))
        assert heard.echo_at == -1

    def test_an_echo_is_no_request_and_no_noise(self, mode):
        heard = self.heard(mode, adu(mode, 1, READ))
        assert (heard.echo_at, heard.requests, heard.responses, heard.has_noise) == (0, (), (), False)

    def test_noise(self, mode):
        assert self.heard(mode, b"\x55\x55").has_noise

    def test_an_echo_behind_noise(self, mode):
        assert self.heard(mode, b"\x55", adu(mode, 1, READ)).echo_at == 1

    def test_requests_in_order_noise_left_out(self, mode):
        heard = self.heard(mode, adu(mode, 1, THEIRS), b"\x55", adu(mode, 2, THEIRS))
        assert heard.requests == (Frame(1, bytes.fromhex(THEIRS)), Frame(2, bytes.fromhex(THEIRS)))

    @pytest.mark.parametrize("pdu", ["41 01", "03 00 30 00 00", "03 02 01 10"])
    def test_what_is_no_request(self, mode, pdu):
        """An unknown function could be anything; the second one asks for nothing; the third one is a response."""
        assert self.heard(mode, adu(mode, 2, pdu)).requests == ()

    def test_what_is_behind_the_response_does_not_matter(self, mode):
        data = adu(mode, 1, RESPONSE) + adu(mode, 1, THEIRS)
        assert overheard(mode, data, adu(mode, 1, READ), adu(mode, 1, RESPONSE)).requests == ()

    def test_all_is_before_a_response_that_is_not_among_what_was_kept(self, mode):
        data = adu(mode, 1, THEIRS) + bytes(20)
        assert len(overheard(mode, data, adu(mode, 1, READ), adu(mode, 1, RESPONSE)).requests) == 1


def test_rtu_tells_the_responses_that_the_framer_passed_over():
    data = adu("rtu", 2, RESPONSE) + adu("rtu", 1, RESPONSE)
    heard = overheard("rtu", data, adu("rtu", 1, READ), adu("rtu", 1, RESPONSE))
    assert heard.responses == (Frame(2, bytes.fromhex(RESPONSE)),)


def test_a_beginning():
    data = adu("rtu", 1, RESPONSE)
    assert has_begun("rtu", b"\x00" + data[:3], data[:3])
    assert not has_begun("rtu", data[:2], data[:3])
    text = adu("ascii", 1, RESPONSE).lower()
    parity = bytes(character | 0x80 for character in text)
    assert has_begun("ascii", text, data[:3])
    assert has_begun("ascii", parity, data[:3])
    assert not has_begun("ascii", text[:6], data[:3])


# --- on a line ---


@pytest.fixture(params=[TIMING, ASCII], ids=["rtu", "ascii"])
def bench(request) -> Bench:
    return Bench(timing=request.param)


def test_a_response_after_another_clients_request_to_the_unit_is_ambiguous(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.pass_time(0.05)
    bench.respond(THEIR_RESPONSE)
    assert bench.client.answers == ["83 0B"]
    assert bench.counts.ambiguous == 1
    assert bench.counts.responses == 0
    assert bench.told(OtherClientHeard) == [OtherClientHeard("hall-a", 1, "unit-1", f"01 {THEIRS}")]


def test_the_answer_that_follows_an_ambiguous_one_is_late(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS)
    bench.respond(THEIR_RESPONSE)
    bench.ask("03 00 20 00 01")
    bench.respond()
    assert bench.client.answers == ["83 0B", "83 0B"]
    assert bench.counts.late_responses == 1


def test_an_ambiguous_response_is_no_failure_of_the_unit(bench: Bench) -> None:
    for _ in range(4):
        bench.ask()
        bench.respond(THEIRS)
        bench.respond()
        bench.pass_time(1.0)
    assert bench.client.answers == ["83 0B"] * 4
    assert bench.devices[1].breaker.failures == 0


def test_another_clients_request_to_another_unit_does_not_matter(bench: Bench) -> None:
    bench.ask()
    bench.respond(THEIRS, unit=2)
    bench.respond(THEIR_RESPONSE, unit=2)
    bench.respond()
    assert bench.client.answers == [RESPONSE]
    assert (bench.counts.ambiguous, len(bench.told(ForeignFrame))) == (0, bench.counts.foreign_frames)
    assert bench.counts.foreign_frames > 0


def test_another_clients_request_behind_the_response_does_not_matter(bench: Bench) -> None:
    bench.ask()
    bench.hear(bench.frame(1, RESPONSE) + bench.frame(1, THEIRS))
    assert bench.client.answers == [RESPONSE]


def test_another_clients_exception_is_ambiguous_too(bench: Bench) -> None:
    bench.ask()
    bench.respond("06 00 01 00 05")
    bench.respond("83 02")
    assert bench.client.answers == ["83 0B"]
    assert bench.counts.exception == 0


def test_another_clients_request_alone_is_foreign(bench: Bench) -> None:
    bench.ask()
    bench.respond("06 00 01 00 05")
    bench.pass_time(1.0)
    assert bench.client.answers == ["83 0B"]
    assert (bench.counts.ambiguous, bench.counts.foreign_frames, bench.counts.bad_frame) == (0, 1, 1)


def test_on_a_real_port_a_request_heard_while_ours_leaves_counts_too(bench: Bench) -> None:
    real = Bench(timing=bench.settings.timing, virtual=False)
    real.ask()
    real.respond(THEIRS)
    real.pass_time(0.05)
    real.respond(THEIR_RESPONSE)
    assert real.client.answers == ["83 0B"]


def test_a_lone_devices_answer_is_ambiguous_when_its_own_address_was_asked(bench: Bench) -> None:
    bench.devices[0] = LoneDevice(bench.device(unit=0).settings, bench.line)
    bench.ask(unit=0)
    bench.respond(THEIRS, unit=77)
    bench.respond(THEIR_RESPONSE, unit=77)
    assert bench.client.answers == ["83 0B"]


def test_lower_case_digits_and_parity_bits_hide_no_request() -> None:
    bench = Bench(timing=ASCII)
    bench.ask()
    bench.hear(adu("ascii", 1, THEIRS).lower().hex())
    bench.hear(bytes(character | 0x80 for character in adu("ascii", 1, RESPONSE).lower()).hex())
    assert bench.client.answers == ["83 0B"]


def test_lower_case_digits_are_no_second_client() -> None:
    bench = Bench(timing=ASCII)
    write = "06 00 01 00 AB"
    bench.ask(write)
    bench.hear(b"zz".hex() + adu("ascii", 1, write).lower().hex())
    assert bench.client.answers == [write]


def test_babble_does_not_hide_a_request() -> None:
    bench = Bench()
    bench.ask()
    bench.respond(THEIRS)
    for _ in range(20):
        bench.hear("55" * 100)
    bench.respond(THEIR_RESPONSE)
    assert bench.client.answers == ["83 0B"]
    assert len(bench.line._hearing._heard) <= 1024 + 100


def test_what_comes_before_the_request_has_left_is_bounded_too() -> None:
    bench = Bench(virtual=False)
    bench.ask()
    for _ in range(100):
        bench.hear("55" * 100)
    assert len(bench.line._hearing._early) <= 1024 + 100
