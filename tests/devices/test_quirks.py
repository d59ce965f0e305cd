"""Devices that stray from the protocol, on a table: moves, changes of rate, questions to address 0."""

import pytest

from gateway.devices.addresses import UnitAddresses
from gateway.devices.quirks import AddressZeroDevice, EveryQuirkyDevice, MovableDevice
from gateway.events import AddressMoved, AddressRemembered, BaudChanged, Event, RequestRefused
from gateway.lines.line import RATE_CHANGE_PAUSE
from gateway.profiles.profile import Profile
from gateway.trace.ring import Ring
from kit.asker import Asker
from kit.line_bench import RESPONSE, Bench, frame

WEIGHER = Profile("weigher", functions=frozenset({3, 16}), quirks=frozenset({"moves", "changes_baud"}))

READ = "03 00 00 00 02"
WEIGHT = "03 04 45 9C 3D 51"
MOVE_TO_5 = "10 01 00 00 01 02 00 05"
MOVED = "10 01 00 00 01"
TO_19200 = "10 02 00 00 02 04 46 96 00 00"
RATE_SET = "10 02 00 00 02"
TAKE_ZERO = "10 1A 00 00 01 02 00 BB"


class Hall(Bench):
    """A bench with a restless device of unit 1, known as silo-1."""

    def __init__(self, *, is_alone: bool = True, profile: Profile = WEIGHER, **settings: object) -> None:
        super().__init__(**settings)
        self.addresses = UnitAddresses()
        self.remembered: list[tuple[int, ...]] = []
        self.rates: list[int] = []
        self.silo = MovableDevice(
            self.device(profile=profile).settings,
            self.line,
            line_name="hall-a",
            line_source="gateway.toml:3",
            addresses=self.addresses,
            change_rate=self.change_rate if is_alone else None,
            remember=self.remember,
            emit=self.events.append,
        )

    def remember(self, *units: int) -> None:
        self.remembered.append(units)

    def change_rate(self, baud: int) -> None:
        self.rates.append(baud)
        self.line.change_rate(baud, self.now)

    def ask_silo(self, pdu: str) -> None:
        self.silo.submit(self.client.ask(pdu, now=self.now), self.now)
        self.pass_time(0.15)

    def told(self, kind: type[Event]) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]


@pytest.fixture
def hall() -> Hall:
    return Hall()


def test_after_two_moves_that_nobody_confirmed_it_is_sought_at_three_places_and_all_are_held(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.pass_time(5.0)
    hall.ask_silo(READ)
    hall.pass_time(5.0)
    hall.ask_silo("10 01 00 00 01 02 00 07")
    hall.pass_time(5.0)
    for unit in (1, 5, 7):
        assert not hall.addresses.is_free(unit, "another")
    sought = []
    for _ in range(4):
        sought.append(hall.silo.unit)
        hall.silo.breaker.record_success()
        hall.ask_silo(READ)
        hall.pass_time(5.0)
    assert sorted(sought[:3]) == [1, 5, 7]
    assert sought[3] == sought[0]
    hall.silo.breaker.record_success()
    hall.ask_silo(READ)
    hall.respond(WEIGHT, unit=hall.silo.unit)
    assert (
        hall.addresses.is_free(5, "another")
        + hall.addresses.is_free(7, "another")
        + hall.addresses.is_free(1, "another")
        == 2
    )


def test_a_read_that_is_sent_again_elsewhere_leaves_its_window_where_it_was_asked() -> None:
    hall = Hall(retries=1)
    hall.silo.submit(hall.client.ask(MOVE_TO_5, now=hall.now), hall.now)
    hall.pass_time(0.05)
    hall.unplug()
    hall.plug()
    hall.pass_time(0.1)
    hall.silo.submit(hall.client.ask("03 00 00 00 01", now=hall.now), hall.now)
    while len(hall.client.answers) < 2:
        hall.pass_time(0.02)
    hall.silo.submit(hall.client.ask("03 00 01 00 01", now=hall.now), hall.now)
    hall.pass_time(0.03)
    hall.respond("03 02 AA AA")
    assert "03 02 AA AA" not in hall.client.answers


def test_a_move_that_a_full_queue_has_no_room_for_is_refused() -> None:
    hall = Hall(queue=2)
    greedy, modest = Asker("10.0.0.8:1", host="10.0.0.8"), Asker("10.0.0.7:1", host="10.0.0.7")
    for client, pdu in [(hall.client, READ), (greedy, "03 00 02 00 02"), (greedy, MOVE_TO_5), (modest, READ)]:
        hall.silo.submit(client.ask(pdu, now=hall.now), hall.now)
    assert greedy.answers == ["90 06"]


def test_a_late_change_of_rate_waits_for_the_end_of_the_transaction_on_the_line(hall: Hall) -> None:
    hall.ask_silo(TO_19200)
    hall.pass_time(0.2)
    hall.ask_silo(READ)
    hall.hear(frame(1, RATE_SET))
    hall.hear(frame(1, WEIGHT))
    assert hall.client.answers[1:] == [WEIGHT]
    assert hall.line.settings.timing.baud == 19200
    hall.silo.submit(hall.client.ask(READ, now=hall.now), hall.now)
    hall.pass_time(RATE_CHANGE_PAUSE - 0.001)
    assert len(hall.written) == 2
    hall.pass_time(0.002)
    assert len(hall.written) == 3


# --- moves ---


def test_a_move_is_answered_from_the_new_address_and_requests_follow(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.hear(frame(5, MOVED))
    hall.ask_silo(READ)
    hall.hear(frame(5, WEIGHT))
    assert hall.written == [frame(1, MOVE_TO_5), frame(5, READ)]
    assert hall.client.answers == [MOVED, WEIGHT]
    assert hall.remembered == [(1, 5), (5,)]


def test_a_move_is_told_with_the_line_of_the_config_to_edit(hall: Hall) -> None:
    hall.silo.source = "gateway.toml:31"
    hall.ask_silo(MOVE_TO_5)
    hall.hear(frame(5, MOVED))
    advice = "requests follow it; set unit = 5 in gateway.toml:31"
    assert hall.events == [AddressMoved("hall-a", "unit-1", 5, 1, advice)]


def test_a_move_is_not_confirmed_from_the_old_address_or_a_third_one(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.hear(frame(1, MOVED))
    hall.hear(frame(6, MOVED))
    assert hall.client.answers == []
    hall.hear(frame(5, MOVED))
    assert hall.client.answers == [MOVED]


def test_a_refused_move_is_no_move(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.hear(frame(1, "90 03"))
    hall.ask_silo(READ)
    assert hall.client.answers == ["90 03"]
    assert hall.written[-1] == frame(1, READ)
    assert hall.told(AddressMoved) == []


def test_a_move_to_the_address_it_has_changes_nothing(hall: Hall) -> None:
    hall.ask_silo("10 01 00 00 01 02 00 01")
    hall.hear(frame(1, MOVED))
    assert hall.client.answers == [MOVED]
    assert hall.told(AddressMoved) == []


@pytest.mark.parametrize("address", [0, 248, 255, 0x0105])
def test_an_address_that_no_device_can_have_is_refused_before_the_line(hall: Hall, address: int) -> None:
    hall.ask_silo(f"10 01 00 00 01 02 {address:04X}")
    assert hall.client.answers == ["90 03"]
    assert hall.written == []


def test_an_address_of_another_device_of_the_line_is_refused_before_the_line(hall: Hall) -> None:
    hall.addresses.place("silo-2", 5)
    hall.ask_silo(MOVE_TO_5)
    assert hall.client.answers == ["90 03"]
    assert hall.written == []


def test_of_two_moves_to_one_address_that_wait_together_the_second_is_refused() -> None:
    hall = Hall()
    settings = hall.device(unit=2, profile=WEIGHER).settings
    other = MovableDevice(
        settings, hall.line, line_name="hall-a", line_source="", addresses=hall.addresses,
        change_rate=None, remember=hall.remember, emit=hall.events.append,
    )  # fmt: skip
    for device in (hall.silo, other):
        device.submit(hall.client.ask(MOVE_TO_5, now=hall.now), hall.now)
    hall.hear(frame(5, MOVED))
    hall.pass_time(0.1)
    assert hall.client.answers == [MOVED, "90 03"]
    assert hall.written == [frame(1, MOVE_TO_5)]


def test_a_request_that_waited_behind_a_move_goes_to_the_new_address(hall: Hall) -> None:
    hall.silo.submit(hall.client.ask(MOVE_TO_5, now=hall.now), hall.now)
    hall.silo.submit(hall.client.ask(READ, now=hall.now), hall.now)
    hall.hear(frame(5, MOVED))
    hall.pass_time(0.1)
    assert hall.written[-1] == frame(5, READ)


def test_after_a_move_that_nobody_confirmed_the_new_address_may_answer(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.pass_time(1)
    assert hall.client.answers == ["90 0B"]
    advice = "old or new: no answer came; it is at 1 or 5, and its next answer settles it"
    assert hall.events[-1] == AddressMoved("hall-a", "unit-1", 5, 1, advice)
    hall.ask_silo(READ)
    hall.hear(frame(5, WEIGHT))
    assert hall.written[1:] == [frame(5, READ)]
    assert hall.client.answers[1:] == [WEIGHT]
    assert hall.remembered == [(1, 5), (5,)]
    assert hall.told(AddressMoved)[1].advice.startswith("requests follow it")


def test_after_a_move_that_nobody_confirmed_the_old_address_may_answer(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.pass_time(1)
    hall.ask_silo(READ)
    hall.pass_time(1)
    hall.ask_silo(READ)
    hall.hear(frame(1, WEIGHT))
    assert hall.written[1:] == [frame(5, READ), frame(1, READ)]
    assert hall.client.answers[1:] == ["83 0B", WEIGHT]
    assert hall.remembered == [(1, 5), (1,)]
    assert hall.addresses.is_free(5, "silo-2")


def test_both_addresses_are_held_until_an_answer_settles_it(hall: Hall) -> None:
    hall.silo.submit(hall.client.ask(MOVE_TO_5, now=hall.now), hall.now)
    assert not hall.addresses.is_free(5, "silo-2")
    hall.pass_time(1)
    assert not hall.addresses.is_free(1, "silo-2")
    assert not hall.addresses.is_free(5, "silo-2")
    hall.ask_silo(READ)
    hall.hear(frame(5, WEIGHT))
    assert hall.addresses.is_free(1, "silo-2")


def test_a_late_confirmation_settles_it(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.pass_time(0.1)
    hall.hear(frame(5, MOVED))
    assert hall.remembered == [(1, 5), (5,)]
    assert hall.addresses.is_free(1, "silo-2")


def test_a_late_exception_to_the_move_settles_it(hall: Hall) -> None:
    hall.ask_silo(MOVE_TO_5)
    hall.pass_time(0.1)
    hall.hear(frame(1, "90 04"))
    assert hall.remembered == [(1, 5), (1,)]
    assert hall.addresses.is_free(5, "silo-2")


def test_a_late_answer_to_what_was_sent_before_a_move_settles_nothing(hall: Hall) -> None:
    """At 5 it is late, and at 1 nobody hears the second move: who works in order might have heard it."""
    hall.silo.begin_at(5, 1)
    hall.ask_silo(READ)
    hall.pass_time(0.1)
    hall.ask_silo("10 01 00 00 01 02 00 07")
    hall.pass_time(0.1)
    assert hall.written == [frame(5, READ), frame(1, "10 01 00 00 01 02 00 07")]
    hall.hear(frame(5, WEIGHT))
    for unit in (1, 5, 7):
        assert not hall.addresses.is_free(unit, "silo-2")


def test_a_move_waits_until_its_unit_owes_nothing(hall: Hall) -> None:
    """The late answer would come from the new address, where it looks like that to another read."""
    hall.ask_silo(READ)
    hall.pass_time(0.1)
    hall.ask_silo(MOVE_TO_5)
    assert hall.client.answers == ["83 0B", "90 0B"]
    assert hall.written == [frame(1, READ)]
    assert hall.remembered == []
    hall.hear(frame(1, WEIGHT))
    hall.ask_silo(MOVE_TO_5)
    assert hall.written[1:] == [frame(1, MOVE_TO_5)]


def test_at_the_old_address_nothing_is_asked_while_the_move_may_still_happen(hall: Hall) -> None:
    """An answer would not show that it stays there."""
    hall.ask_silo(MOVE_TO_5)
    hall.pass_time(0.1)
    hall.silo.unit = 1
    hall.ask_silo(READ)
    assert hall.client.answers == ["90 0B", "83 0B"]
    assert hall.written == [frame(1, MOVE_TO_5)]


def test_an_unconfirmed_move_to_its_own_address_leaves_no_doubt(hall: Hall) -> None:
    hall.ask_silo("10 01 00 00 01 02 00 01")
    hall.pass_time(1)
    assert hall.told(AddressMoved) == []
    assert hall.remembered == []


def test_a_device_begins_where_it_moved_to_in_an_earlier_run(hall: Hall) -> None:
    hall.silo.begin_at(5)
    hall.ask_silo(READ)
    assert hall.written == [frame(5, READ)]


def test_a_device_that_may_have_moved_in_an_earlier_run_is_asked_at_both_addresses(hall: Hall) -> None:
    hall.silo.begin_at(1, 5)
    assert not hall.addresses.is_free(5, "silo-2")
    for _ in range(3):
        hall.ask_silo(READ)
        hall.pass_time(1)
    assert hall.written == [frame(1, READ), frame(5, READ), frame(1, READ)]


def test_a_device_that_is_silent_where_it_moved_to_is_asked_nowhere_else(hall: Hall) -> None:
    """At the address in the config there may be a spare."""
    hall.silo.begin_at(5)
    for _ in range(4):
        hall.ask_silo(READ)
        hall.pass_time(20)
    assert hall.written == [frame(5, READ)] * 4


def test_how_to_ask_it_where_the_config_says_is_told_once_it_rests(hall: Hall) -> None:
    hall.silo.begin_at(5)
    for _ in range(6):
        hall.ask_silo(READ)
        hall.pass_time(0.7)
    advice = "it does not answer there; if it is at 1 again: modbus-gateway forget unit-1"
    assert hall.told(AddressRemembered) == [AddressRemembered("hall-a", "unit-1", 5, 1, advice)]


def test_of_a_device_that_is_where_the_config_says_nothing_is_told_when_it_rests(hall: Hall) -> None:
    for _ in range(6):
        hall.ask_silo(READ)
        hall.pass_time(0.7)
    assert hall.told(AddressRemembered) == []


def test_a_device_without_an_address_is_not_asked(hall: Hall) -> None:
    hall.silo.begin_at()
    hall.ask_silo(READ)
    assert hall.client.answers == ["83 0A"]
    assert hall.written == []
    (told,) = hall.told(RequestRefused)
    assert told.why == "another device may be at its address: see address_remembered at the start"


def test_a_read_of_the_address_register_is_no_move(hall: Hall) -> None:
    hall.ask_silo("03 01 00 00 01")
    hall.hear(frame(1, RESPONSE))
    assert hall.client.answers == [RESPONSE]


ANYTHING = Profile("anything", quirks=frozenset({"moves", "changes_baud"}))


@pytest.mark.parametrize(
    ("move", "moved"),
    [
        ("06 01 00 00 05", "06 01 00 00 05"),
        ("10 00 FF 00 03 06 00 00 00 05 00 00", "10 00 FF 00 03"),
        ("17 00 00 00 01 01 00 00 01 02 00 05", "17 02 00 07"),
    ],
)
def test_every_function_that_writes_the_address_is_a_move(move: str, moved: str) -> None:
    hall = Hall(profile=ANYTHING)
    hall.ask_silo(move)
    hall.hear(frame(5, moved))
    assert hall.client.answers == [moved]
    assert hall.remembered[-1] == (5,)
    hall.addresses.place("silo-2", 7)
    hall.ask_silo(move.replace("00 05", "00 07"))
    assert hall.client.answers[1:] == [f"{int(move[:2], 16) | 0x80:02X} 03"]


@pytest.mark.parametrize("pdu", ["16 01 00 00 00 00 05", "10 02 00 00 01 02 46 96", "10 02 01 00 02 04 00 00 00 00"])
def test_an_address_or_a_rate_that_is_not_written_whole_is_refused(pdu: str) -> None:
    hall = Hall(profile=ANYTHING)
    hall.ask_silo(pdu)
    assert hall.written == []
    (told,) = hall.told(RequestRefused)
    assert (told.code, told.why) == ("03", "its address and its rate can only be written with all of their registers")


# --- broadcasts ---


@pytest.mark.parametrize(
    "pdu",
    [
        *("06 01 00 00 05", MOVE_TO_5, "10 00 FF 00 03 06 00 00 00 05 00 00", "16 01 00 00 00 00 05"),
        *(TO_19200, "10 01 FF 00 02 04 00 00 46 96", "06 02 01 00 00"),
    ],
)
def test_no_broadcast_writes_an_address_or_a_rate(hall: Hall, pdu: str) -> None:
    everyone = EveryQuirkyDevice(hall.line, {"moves", "changes_baud"}, hall.events.append, Ring(), "hall-a")
    everyone.submit(hall.client.ask(pdu, unit=0, now=hall.now), hall.now)
    hall.pass_time(1)
    assert hall.written == []
    (told,) = hall.told(RequestRefused)
    assert (told.unit, told.code, told.device) == (0, "03", "every device of hall-a")
    assert hall.client.answers == [f"{int(pdu[:2], 16) | 0x80:02X} 03"]


@pytest.mark.parametrize(("quirk", "pdu"), [("moves", TO_19200), ("changes_baud", MOVE_TO_5), ("moves", TAKE_ZERO)])
def test_other_broadcasts_are_sent(hall: Hall, quirk: str, pdu: str) -> None:
    everyone = EveryQuirkyDevice(hall.line, {quirk}, hall.events.append, Ring(), "hall-a")
    everyone.submit(hall.client.ask(pdu, unit=0, now=hall.now), hall.now)
    hall.pass_time(1)
    assert hall.written == [frame(0, pdu)]
    assert hall.client.answers == [None]


# --- changes of rate ---


def test_the_line_follows_its_only_device_to_the_new_rate(hall: Hall) -> None:
    hall.ask_silo(TO_19200)
    hall.hear(frame(1, RATE_SET))
    assert hall.client.answers == [RATE_SET]
    assert hall.rates == [19200]
    assert hall.events == [
        BaudChanged("hall-a", "unit-1", 19200.0, "the line follows it; set baud = 19200 in gateway.toml:3")
    ]


def test_nothing_is_sent_for_a_moment_after_a_change_of_rate(hall: Hall) -> None:
    hall.ask_silo(TO_19200)
    hall.silo.submit(hall.client.ask(READ, now=hall.now), hall.now)
    hall.hear(frame(1, RATE_SET))
    hall.pass_time(0.099)
    assert len(hall.written) == 1
    hall.pass_time(0.002)
    assert len(hall.written) == 2


def test_a_line_with_other_devices_stays_at_its_rate_and_says_so() -> None:
    hall = Hall(is_alone=False)
    hall.ask_silo(TO_19200)
    hall.hear(frame(1, RATE_SET))
    assert hall.rates == []
    assert hall.told(BaudChanged)[0].advice.startswith("the line stays at its rate")


def test_a_refused_rate_changes_nothing(hall: Hall) -> None:
    hall.ask_silo(TO_19200)
    hall.hear(frame(1, "90 03"))
    assert (hall.rates, hall.events) == ([], [])


def test_an_unanswered_change_of_rate_is_told(hall: Hall) -> None:
    hall.ask_silo(TO_19200)
    hall.pass_time(1)
    assert hall.rates == []
    assert hall.told(BaudChanged)[0].advice.startswith("old or new")


@pytest.mark.parametrize("rate", ["00 00 00 00", "7F 80 00 00", "7F C0 00 00", "46 16 00 01", "C6 16 00 00"])
def test_a_rate_that_cannot_be_is_not_followed(hall: Hall, rate: str) -> None:
    hall.ask_silo("10 02 00 00 02 04" + rate)
    hall.hear(frame(1, RATE_SET))
    assert hall.rates == []
    assert hall.client.answers == [RATE_SET]


# --- address 0 ---


@pytest.mark.parametrize("answers_from", [1, 77, 247])
def test_a_lone_device_is_asked_at_0_and_answers_from_wherever_it_is(answers_from: int) -> None:
    bench = Bench()
    AddressZeroDevice(bench.device(unit=0).settings, bench.line).submit(bench.client.ask("03 00 10 00 01"), bench.now)
    assert bench.written == ["00 03 00 10 00 01 84 1E"]
    bench.hear(frame(answers_from, "03 02 00 01"))
    assert bench.client.answers == ["03 02 00 01"]


def test_noise_before_the_answer_of_a_lone_device_does_not_lose_it() -> None:
    bench = Bench()
    AddressZeroDevice(bench.device(unit=0).settings, bench.line).submit(bench.client.ask("03 00 10 00 01"), bench.now)
    bench.hear("03 02 00 FF" + frame(1, "03 02 00 01"))
    assert bench.client.answers == ["03 02 00 01"]


@pytest.mark.parametrize("answers_from", [0, 1, 247, 248, 255])
def test_a_lone_device_may_answer_from_any_address(answers_from: int) -> None:
    bench = Bench()
    AddressZeroDevice(bench.device(unit=0).settings, bench.line).submit(bench.client.ask("03 00 10 00 01"), bench.now)
    bench.hear(frame(0, "03 00 10 00 01"))  # an echo, or another client that asks there
    bench.hear(frame(answers_from, "03 02 00 01"))
    assert bench.client.answers == ["03 02 00 01"]


def test_bits_of_the_address_are_not_written() -> None:
    hall = Hall()
    request = hall.client.ask("16 01 00 FF FE 00 01", now=hall.now)
    request.in_one_turn = 16
    hall.silo.submit(request, hall.now)
    assert hall.client.answers == ["96 03"]
    assert hall.written == []


def test_bits_are_written_where_a_device_has_moved_to() -> None:
    hall = Hall()
    hall.ask_silo(MOVE_TO_5)
    hall.respond(MOVED, unit=5)
    hall.written.clear()
    request = hall.client.ask("16 00 08 FF FE 00 01", now=hall.now)
    request.in_one_turn = 16
    hall.silo.submit(request, hall.now)
    hall.pass_time(0.02)
    hall.respond("03 02 00 02", unit=5)
    hall.pass_time(0.02)
    assert hall.written == [frame(5, "03 00 08 00 01"), frame(5, "10 00 08 00 01 02 00 03")]
