"""A mirror on the table: its device answers when the test says so, and time is a number."""

import pytest

from gateway.events import PollRefused
from gateway.images.mirror import Mirror
from gateway.images.polling import DevicePolls, PolledUnit
from gateway.images.polls import MirrorSettings, Poll
from gateway.images.turns import MOST_POLLS, PollTurns
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.holes import Holes
from gateway.profiles.profile import Profile
from gateway.profiles.read_rules import ReadRules
from gateway.request import Caller, Origin, Request
from kit.target import CallingTarget

FIVE = "03 02 00 05"
SIX = "03 02 00 06"


class Bench(Origin):
    """A mirror, its device, its poller and its clients in one: whoever asks is written beside what was asked."""

    def __init__(self, *polls: Poll, stale: float = 2.0, profile: Profile | None = None) -> None:
        self.caller = Caller("mirror", "127.0.0.1", "127.0.0.1")
        profile = profile or Profile("generic")
        polls = polls or (Poll(Area.HOLDING, 0, 0, 0.5),)
        areas = {}
        for poll in polls:
            areas[poll.area] = tuple(sorted({*areas.get(poll.area, ()), (poll.first, poll.last)}))
        self.events = []
        self.now = 0.0
        self.asked: list[Request] = []
        self.rests = False
        self.holes = Holes()
        settings = MirrorSettings(241, "silo", "silo-1", profile, polls, areas, stale, "gateway.toml:9")
        unit = PolledUnit("silo-1", 1, ReadRules.of(profile))
        self.polls = DevicePolls(unit, self, self, PollTurns(), self.events.append)
        self.mirror = Mirror(settings, self.polls, CallingTarget(self.submit), self, self.events.append)
        self.polls.change(self.mirror.parts, (), 0.0)

    # the device

    def submit(self, request, now, *, yields=False):
        assert yields == (request.origin is self)
        self.asked.append(request)

    def is_resting(self, now):
        return self.rests

    def answers(self, pdu: str | None, which: int = 0) -> None:
        """The device answers a question, the oldest one unless said otherwise."""
        request, response = self.asked.pop(which), None if pdu is None else bytes.fromhex(pdu)
        request.origin.answer(request, response)

    # the poller

    def wants(self, request):
        return True

    def answer(self, request, pdu):
        self.polls.polled(request, pdu, self.now)

    def passed(self, request, polls, sent, response):
        self.mirror.wrote(request, polls, sent, response, self.now)
        self.mirror.passed(request, response, self.now)

    # the test

    def at(self, now: float) -> list[str]:
        """Let time pass; what is being asked then."""
        self.now = now
        while (deadline := self.polls.deadline()) is not None and deadline <= now:
            self.polls.tick(now)
        return self.questions

    @property
    def questions(self) -> list[str]:
        return [request.pdu.hex(" ").upper() for request in self.asked]

    def ages(self):
        return [age for _, age in self.mirror.ages(self.now)]


class Client(Origin):
    def __init__(self, bench: Bench, client: str = "10.0.0.9:1") -> None:
        self.caller = Caller(client, "127.0.0.1", "127.0.0.1")
        self.is_there = True
        #: What it asks as soon as it has an answer.
        self.next: list[str] = []
        self._bench = bench
        self._came = []

    def wants(self, request):
        return self.is_there

    def answer(self, request, pdu):
        self._came.append(None if pdu is None else pdu.hex(" ").upper())
        questions, self.next = self.next, []
        for question in questions:
            self._send(question)

    def ask(self, pdu: str = "03 0000 0001"):
        """Ask; what has come so far."""
        self._send(pdu)
        return self.came()

    def _send(self, pdu):
        request = Request(241, bytes.fromhex(pdu), self, self._bench.now)
        self._bench.mirror.submit(request, self._bench.now)

    def came(self):
        came, self._came = self._came, []
        return came


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def fresh(bench):
    """A mirror that was polled at 0 s."""
    bench.at(0.0)
    bench.answers(FIVE)
    return bench


def test_a_read_is_answered_from_the_last_poll(fresh):
    client = Client(fresh)
    assert client.ask() == [FIVE]
    assert client.ask() == [FIVE]
    assert fresh.questions == []


def test_polls_keep_their_pace_and_do_not_pile_up(fresh):
    assert fresh.at(0.4) == []
    assert fresh.at(0.5) == ["03 00 00 00 01"]
    assert fresh.polls.deadline() is None
    assert len(fresh.at(5.0)) == 1
    fresh.answers(SIX)
    assert fresh.polls.deadline() == 1.0
    assert len(fresh.at(5.0)) == 1
    assert fresh.mirror.counts.polls == 2


def test_an_old_value_is_never_given_out(fresh):
    client = Client(fresh)
    fresh.at(2.0)
    assert client.ask() == [FIVE]
    fresh.at(2.1)
    assert client.ask() == ["83 0B"]
    fresh.answers(SIX)  # the poll of 2.0 s
    assert client.ask() == [SIX]


def test_a_value_is_as_old_as_the_question(bench):
    bench.at(0.0)
    bench.at(1.5)
    bench.answers(FIVE)
    assert bench.ages() == [1.5]
    bench.now = 2.1
    assert Client(bench).ask() == ["83 0B"]


def test_the_first_poll_is_waited_for(bench):
    client = Client(bench)
    bench.at(0.0)
    assert client.ask() == []
    bench.answers(FIVE)
    assert client.came() == [FIVE]


def test_a_poll_from_before_a_write_tells_a_mirror_nothing_that_came_after_it(fresh):
    fresh.at(0.5)
    writer = Client(fresh)
    writer.ask("06 0000 0006")
    fresh.answers("06 0000 0006", which=1)
    fresh.mirror = Mirror(fresh.mirror.settings, fresh.polls, CallingTarget(fresh.submit), fresh, fresh.events.append)
    fresh.polls.change(fresh.mirror.parts, (), 0.5)
    client = Client(fresh)
    assert client.ask() == []
    fresh.answers(FIVE)  # the device had read it before it wrote
    assert client.came() == []
    assert fresh.at(0.5) == ["03 00 00 00 01"]
    fresh.answers(SIX)
    assert client.came() == [SIX]


@pytest.mark.parametrize("failure", ["83 0B", "83 0A", "83 06", "83 02", None])
def test_a_poll_that_fails_ends_the_waiting(bench, failure):
    client = Client(bench)
    bench.at(0.0)
    client.ask()
    bench.answers(failure)
    assert client.came() == ["83 0B"]
    assert client.ask() == ["83 0B"]
    assert bench.ages() == [None]
    assert bench.mirror.counts.failed == 1


def test_a_failed_poll_leaves_fresh_values_fresh(fresh):
    fresh.at(0.5)
    fresh.answers("83 0B")
    assert Client(fresh).ask() == [FIVE]
    assert fresh.ages() == [0.5]


def test_a_resting_unit_is_not_polled(fresh):
    fresh.rests = True
    assert fresh.at(0.5) == fresh.at(1.0) == []
    fresh.rests = False
    assert fresh.at(1.5) == ["03 00 00 00 01"]


def test_nobody_waits_for_a_unit_that_rests(bench):
    bench.rests = True
    client = Client(bench)
    client.ask()
    bench.at(0.0)
    assert client.came() == ["83 0B"]


# --- what a mirror has -----------------------------------------------------------------------------


def test_what_is_not_polled_does_not_exist(fresh):
    client = Client(fresh)
    assert client.ask("03 0001 0001") == ["83 02"]
    assert client.ask("03 0000 0002") == ["83 02"]
    assert client.ask("04 0000 0001") == ["84 02"]
    assert client.ask("03 0000 0000") == ["83 03"]
    assert fresh.mirror.answer_counts.exceptions == 4


def test_the_profile_of_the_device_holds():
    bench = Bench(profile=Profile("narrow", functions=frozenset({3}), limits={3: 1}))
    client = Client(bench)
    assert client.ask("04 0000 0001") == ["84 01"]
    assert client.ask("03 0000 0002") == ["83 03"]


def test_every_area_can_be_mirrored():
    bench = Bench(Poll(Area.COILS, 0, 9, 1.0), Poll(Area.DISCRETE, 3, 3, 1.0), Poll(Area.INPUT, 0, 0, 1.0), stale=10.0)
    client = Client(bench)
    assert bench.at(0.0) == ["01 00 00 00 0A", "02 00 03 00 01", "04 00 00 00 01"]
    for response in ("01 02 FF 03", "02 01 01", "04 02 12 34"):
        bench.answers(response)
    assert client.ask("01 0004 0006") == ["01 01 3F"]
    assert client.ask("02 0003 0001") == ["02 01 01"]
    assert client.ask("04 0000 0001") == ["04 02 12 34"]


def test_a_read_over_two_ranges_needs_both():
    bench = Bench(Poll(Area.HOLDING, 0, 0, 0.5), Poll(Area.HOLDING, 1, 1, 5.0))
    bench.mirror._tables[Area.HOLDING].ranges = ((0, 1),)
    bench.at(0.0)
    bench.answers("03 02 00 05")
    client = Client(bench)
    assert client.ask("03 0000 0002") == []
    bench.answers("03 02 00 06")
    assert client.came() == ["03 04 00 05 00 06"]
    bench.at(2.0)
    bench.answers("03 02 00 07")
    bench.now = 2.1
    assert client.ask("03 0000 0001") == ["03 02 00 07"]
    assert client.ask("03 0000 0002") == ["83 0B"]


# --- refusals --------------------------------------------------------------------------------------


def test_ranges_that_the_device_refuses_to_read_together_are_read_apart():
    bench = Bench(Poll(Area.HOLDING, 0, 0, 0.5), Poll(Area.HOLDING, 1, 1, 0.5))
    client = Client(bench)
    assert bench.at(0.0) == ["03 00 00 00 02"]
    client.ask("03 0000 0001")
    bench.answers("83 02")
    assert client.came() == []
    assert bench.at(0.0) == ["03 00 00 00 01", "03 00 01 00 01"]
    bench.answers(FIVE)
    bench.answers("83 02")
    assert client.came() == [FIVE]
    assert client.ask("03 0001 0001") == ["83 0B"]
    assert bench.events == [PollRefused("mirror silo", "silo-1", "holding 1", 2, "gateway.toml:9")]


def bridging(*more: Poll) -> Bench:
    """A mirror of two registers with two between them, which are read with them, and `more`."""
    polls = (Poll(Area.HOLDING, 0, 0, 0.5), Poll(Area.HOLDING, 3, 3, 0.5))
    return Bench(*polls, *more, profile=Profile("generic", max_gap=2), stale=9.0)


def test_a_poll_over_a_hole_gives_only_what_is_declared():
    bench = bridging()
    assert bench.at(0.0) == ["03 00 00 00 04"]
    bench.answers("03 08 0001 0002 0003 0004")
    client = Client(bench)
    assert client.ask("03 0000 0001") == ["03 02 00 01"]
    assert client.ask("03 0003 0001") == ["03 02 00 04"]
    assert client.ask("03 0001 0001") == client.ask("03 0000 0004") == ["83 02"]


def test_a_poll_over_a_hole_leaves_the_values_there_to_the_poll_that_is_for_them():
    """It may have been under way when a client wrote there: then its value is older than that of the later poll."""
    bench = bridging(Poll(Area.HOLDING, 1, 1, 5.0))
    assert bench.at(0.0) == ["03 00 00 00 04", "03 00 01 00 01"]
    bench.answers("03 02 0007", 1)
    bench.answers("03 08 0001 0002 0003 0004")
    assert Client(bench).ask("03 0001 0001") == ["03 02 00 07"]


def test_a_poll_over_a_hole_that_fails_takes_nothing_from_the_values_there():
    bench = bridging(Poll(Area.HOLDING, 1, 1, 5.0))
    bench.at(0.0)
    bench.answers("03 02 0007", 1)
    bench.answers(None)
    assert Client(bench).ask("03 0001 0001") == ["03 02 00 07"]
    assert Client(bench).ask("03 0000 0001") == ["83 0B"]


def test_inputs_are_polled_over_holes_too():
    polls = (Poll(Area.DISCRETE, 8, 8, 0.5), Poll(Area.DISCRETE, 11, 12, 0.5))
    bench = Bench(*polls, profile=Profile("generic", max_gap=2))
    assert bench.at(0.0) == ["02 00 08 00 05"]
    bench.answers("02 01 17")
    assert Client(bench).ask("02 0008 0001") == ["02 01 01"]
    assert Client(bench).ask("02 000B 0002") == ["02 01 02"]


def test_a_refused_hole_is_remembered_for_the_device_and_not_told():
    bench = bridging()
    bench.at(0.0)
    bench.answers("83 02")
    assert bench.at(0.0) == ["03 00 00 00 01", "03 00 03 00 01"]
    bench.answers("03 02 0001")
    assert bench.holes.refused == ()
    bench.answers("03 02 0004")
    assert bench.holes.refuse(Span(Area.HOLDING, 1, 2))
    assert bench.events == []


def test_every_hole_at_which_a_poll_was_split_is_remembered():
    bench = bridging(Poll(Area.HOLDING, 6, 6, 0.5))
    assert bench.at(0.0) == ["03 00 00 00 07"]
    bench.answers("83 03")
    assert bench.at(0.0) == ["03 00 00 00 04", "03 00 06 00 01"]
    bench.answers("83 04")
    assert bench.at(0.0) == ["03 00 06 00 01", "03 00 00 00 01", "03 00 03 00 01"]
    for value in ("0007", "0001", "0004"):
        bench.answers(f"03 02 {value}")
    assert [hole.addresses for hole in bench.holes.refused] == ["1-2", "4-5"]


def test_a_range_that_appears_later_says_nothing_of_the_hole():
    bench = bridging()
    bench.at(0.0)
    bench.answers("83 02")
    bench.at(0.0)
    bench.answers("03 02 0001")
    bench.answers("83 02")
    bench.at(0.5)
    bench.answers("03 02 0001")
    bench.answers("03 02 0004")
    assert bench.holes.refused == ()


def test_a_refusal_is_told_once_until_the_device_answers(bench):
    for now, response in enumerate(["83 02", "83 02", FIVE, "83 02"]):
        bench.at(float(now))
        bench.answers(response)
    assert len(bench.events) == 2


# --- everything else goes through ------------------------------------------------------------------


def test_a_write_goes_through_and_what_it_changes_is_polled(fresh):
    client = Client(fresh)
    assert client.ask("06 0000 0006") == []
    assert fresh.questions == ["06 00 00 00 06"]
    fresh.now = 0.2
    fresh.answers("06 0000 0006")
    assert client.came() == ["06 00 00 00 06"]
    assert client.ask() == []
    assert fresh.at(0.2) == ["03 00 00 00 01"]
    fresh.answers(SIX)
    assert client.came() == [SIX]


def test_what_a_client_asks_behind_its_write_waits_for_it_and_others_do_not(fresh):
    writer, reader = Client(fresh), Client(fresh, "10.0.0.8:1")
    writer.ask("06 0000 0006")
    assert (writer.ask(), reader.ask()) == ([], [FIVE])
    fresh.answers("06 0000 0006")
    fresh.at(0.0)
    fresh.answers(SIX)
    assert writer.came() == ["06 00 00 00 06", SIX]


@pytest.mark.parametrize(
    ("response", "is_known"), [("86 02", True), ("86 0A", True), ("86 0B", False), ("86 04", False)]
)
def test_a_write_that_had_no_effect_costs_no_poll(fresh, response, is_known):
    client = Client(fresh)
    client.ask("06 0000 0006")
    fresh.answers(response)
    assert client.came() == [bytes.fromhex(response).hex(" ").upper()]
    assert client.ask() == ([FIVE] if is_known else [])


def test_a_write_elsewhere_leaves_the_values_alone(fresh):
    client = Client(fresh)
    client.ask("06 0001 0006")
    assert client.ask() == []
    fresh.answers("06 0001 0006")
    assert client.came() == ["06 00 01 00 06", FIVE]
    assert client.ask() == [FIVE]
    assert fresh.questions == []


def test_a_write_of_an_unknown_kind_may_have_changed_everything(fresh):
    client = Client(fresh)
    client.ask("41 00")
    assert client.ask() == []
    fresh.answers("41 00")
    assert fresh.at(0.0) == ["03 00 00 00 01"]
    fresh.answers(SIX)
    assert client.came() == ["41 00", SIX]


def test_a_write_that_nobody_wants_any_more_is_not_sent(fresh):
    client = Client(fresh)
    client.ask("06 0000 0006")
    (write,) = fresh.asked
    assert write.origin.wants(write)
    client.is_there = False
    assert not write.origin.wants(write)
    fresh.answers(None)
    assert client.came() == [None]
    assert client.ask() == [FIVE]


def test_a_malformed_write_is_refused_here(fresh):
    assert Client(fresh).ask("06 0000") == ["86 03"]
    assert fresh.questions == []


@pytest.mark.parametrize(
    ("question", "answer"), [("11", "11 02 07 FF"), ("2B 0E 04 00", "2B 0E 04 01 00 00 01 00 01 41")]
)
def test_other_questions_go_to_the_device_and_change_nothing(fresh, question, answer):
    client = Client(fresh)
    client.ask(question)
    assert fresh.questions == [question]
    fresh.answers(answer)
    assert client.came() == [answer]
    assert client.ask() == [FIVE]


# --- order -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_poll_first", [True, False])
def test_a_poll_that_was_asked_before_a_write_shows_nothing_of_it(fresh, is_poll_first):
    """Behind an upstream, poll and write are under way side by side."""
    client = Client(fresh)
    fresh.at(0.5)
    client.ask("06 0000 0006")
    if is_poll_first:
        fresh.answers(FIVE)
        fresh.answers("06 0000 0006")
    else:
        fresh.answers("06 0000 0006", 1)
        fresh.answers(FIVE)
    assert client.came() == ["06 00 00 00 06"]
    assert client.ask() == []
    assert fresh.ages() == [None]
    assert fresh.at(0.5) == ["03 00 00 00 01"]
    fresh.answers(SIX)
    assert client.came() == [SIX]


def test_whoever_asked_before_the_end_of_a_write_needs_not_wait_for_it(bench):
    """Otherwise a client that writes on and on would let others wait for ever."""
    reader, writer = Client(bench, "10.0.0.8:1"), Client(bench)
    bench.at(0.0)
    reader.ask()
    writer.ask("06 0000 0006")
    bench.answers("06 0000 0006", 1)
    bench.answers(FIVE)
    assert reader.came() == [FIVE]
    assert reader.ask() == []


def test_a_write_waits_for_what_its_client_has_asked_before(bench):
    client = Client(bench)
    bench.at(0.0)
    client.ask()
    client.ask("06 0000 0006")
    client.ask()
    assert bench.questions == ["03 00 00 00 01"]
    bench.answers(FIVE)
    assert client.came() == [FIVE]
    assert bench.questions == ["06 00 00 00 06"]
    bench.answers("06 0000 0006")
    bench.at(0.0)
    bench.answers(SIX)
    assert client.came() == ["06 00 00 00 06", SIX]


def test_a_write_does_not_wait_for_what_others_have_asked(bench):
    reader, writer = Client(bench, "10.0.0.8:1"), Client(bench)
    bench.at(0.0)
    reader.ask()
    writer.ask("06 0000 0006")
    assert bench.questions == ["03 00 00 00 01", "06 00 00 00 06"]


def test_writes_of_one_client_are_handed_on_one_behind_the_other(fresh):
    client = Client(fresh)
    client.ask("06 0000 0006")
    client.ask("06 0000 0007")
    assert fresh.questions == ["06 00 00 00 06", "06 00 00 00 07"]
    client.ask()
    fresh.answers("06 0000 0006")
    fresh.at(0.0)
    assert client.came() == ["06 00 00 00 06"]
    fresh.answers("06 0000 0007")
    fresh.answers(SIX)
    assert client.came() == ["06 00 00 00 07"]
    assert fresh.at(0.0) == ["03 00 00 00 01"]


def test_a_read_waits_for_the_answer_to_any_question_before_it(fresh):
    client = Client(fresh)
    client.ask("11")
    assert client.ask() == []
    fresh.answers("11 02 07 FF")
    assert client.came() == ["11 02 07 FF", FIVE]


def test_a_client_may_ask_on_while_it_is_answered(fresh):
    client = Client(fresh)
    client.next = ["03 0000 0001", "06 0000 0006", "03 0000 0001"]
    assert client.ask() == [FIVE, FIVE]
    fresh.answers("06 0000 0006")
    fresh.at(0.0)
    fresh.answers(SIX)
    assert client.came() == ["06 00 00 00 06", SIX]


# --- the end ---------------------------------------------------------------------------------------


def test_what_waits_at_the_end_fails(bench):
    client = Client(bench)
    bench.at(0.0)
    client.ask()
    client.ask("06 0000 0006")
    bench.mirror.close(0.0)
    assert client.came() == ["83 0B"]
    assert bench.questions == ["03 00 00 00 01", "06 00 00 00 06"]


def test_what_would_wait_after_the_end_fails(fresh):
    client = Client(fresh)
    client.ask("06 0000 0006")
    client.ask()
    fresh.mirror.close(0.0)
    assert client.came() == []
    fresh.answers("06 0000 0006")
    assert client.came() == ["06 00 00 00 06", "83 0B"]
    assert client.ask() == ["83 0B"]


def test_the_repr_is_a_status_line(fresh):
    assert repr(fresh.mirror) == "<Mirror silo of silo-1 polls=1 failed=0>"


def test_a_poll_that_could_not_be_sent_is_tried_again_soon():
    bench = Bench(Poll(Area.HOLDING, 0, 0, 60.0))
    bench.at(0.0)
    bench.answers("83 0A")
    assert bench.at(0.9) == []
    assert bench.at(1.0) == ["03 00 00 00 01"]
    bench.answers("83 0B")
    assert bench.at(5.9) == []
    assert bench.at(6.0) == ["03 00 00 00 01"]


@pytest.mark.parametrize("unsent", ["83 0A", "83 06"])
def test_a_poll_that_could_not_be_sent_is_not_tried_again_at_its_own_pace(unsent):
    """A line without a port refuses at once: a poll each 10 ms would take the processor from all others."""
    bench = Bench(Poll(Area.HOLDING, 0, 0, 0.01))
    bench.at(0.0)
    bench.answers(unsent)
    assert bench.at(0.2) == []
    assert bench.at(0.3) == ["03 00 00 00 01"]


def test_a_mirror_of_many_ranges_does_not_fill_the_queue_of_its_line():
    bench = Bench(Poll(Area.HOLDING, 0, 65535, 1.0))
    assert len(bench.at(0.0)) == MOST_POLLS
    assert bench.polls.deadline() is None
    bench.answers("83 0B")
    asked = bench.questions
    assert len(asked) == MOST_POLLS
    assert asked[-1] == "03 07 D0 00 7D"


def test_a_write_elsewhere_may_have_changed_the_values_too_so_that_they_are_polled_soon():
    bench = Bench(Poll(Area.HOLDING, 0, 0, 60.0), stale=120.0)
    bench.at(0.0)
    bench.answers(FIVE)
    client = Client(bench)
    client.ask("06 1A00 00BB")
    bench.now = 1.0
    bench.answers("06 1A00 00BB")
    assert client.came() == ["06 1A 00 00 BB"]
    assert bench.at(1.0) == ["03 00 00 00 01"]
    bench.answers(SIX)
    assert client.ask() == [SIX]


def test_registers_of_four_bytes_are_not_polled_and_not_read() -> None:
    profile = Profile("enron", wide={Area.HOLDING: ((4, 7),)})
    bench = Bench(Poll(Area.HOLDING, 0, 1, 0.5), Poll(Area.HOLDING, 4, 5, 0.5), profile=profile)
    assert bench.at(0.0) == ["03 00 00 00 02"]
    bench.answers("03 04 00 05 00 06")
    client = Client(bench)
    assert client.ask("03 0004 0001") == ["83 02"]
    assert client.ask("03 0000 0002") == ["03 04 00 05 00 06"]
