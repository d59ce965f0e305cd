"""Nobody looks for a usual response before it should be there; nothing is heard differently for it, or much later."""

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.lines.foresight import CALM
from gateway.lines.pacing import LONGEST
from gateway.modbus.rtu import encode
from gateway.timing.characters import CharacterFormat, LineTiming
from kit.line_bench import REQUEST_TIME, TIMING
from kit.virtual_time import VirtualTimeLoop
from kit.wired import READ_TEN, Wired

CHARACTER = TIMING.character
#: The response to a read of ten registers, its exception, and another unit's.
TEN = encode(1, bytes.fromhex("03 14") + bytes(range(20)))
EXCEPTION = encode(1, bytes.fromhex("83 02"))
OF_ANOTHER = encode(2, bytes.fromhex("03 14") + bytes(20))
#: Other clients' requests, to another unit and to ours.
OTHERS = encode(2, bytes.fromhex(READ_TEN))
ANOTHER = encode(1, bytes.fromhex("03 00 40 00 0A"))


class Talk:
    """What a device does with one request: it says `data`, `delay` seconds after the end of the request.

    A whole TEN in it gets values of its own, which tell to what request they belong.
    `before` is on the idle line before the request, after `calm` seconds of quiet; `early` while that is being sent.
    """

    def __init__(
        self, data: bytes = TEN, delay: float = 0.004, before: bytes = b"", early: bytes = b"", calm: float = 0.0
    ) -> None:
        self.data = data
        self.delay = delay
        self.before = before
        self.early = early
        self.calm = calm

    def __repr__(self) -> str:
        around = f"before={self.before.hex()}, early={self.early.hex()}, calm={self.calm}"
        return f"Talk({self.data.hex()}, {self.delay}, {around})"


class Asked:
    """What became of one request: the answer, how often the line was woken, and how late after the last byte it was.

    `own` are the values that its device has sent.
    """

    def __init__(self, answer: str, own: str, wakes: int, late: float) -> None:
        self.answer = answer
        self.own = own
        self.wakes = wakes
        self.late = late


async def talk(wired: Wired, each: Talk) -> Asked:
    """Ask for ten registers, and let the device do `each`."""
    loop, answers, character = wired.loop, wired.client.answers, wired.timing.character
    await asyncio.sleep(each.calm)
    await wired.says(each.before)
    await asyncio.sleep(0.02 if each.before else 0.0)
    wakes, known = wired.user.wakes, len(answers)
    now = loop.time()
    wired.device.submit(wired.client.ask(READ_TEN, now=now), now)
    ends_at = now + wired.timing.frame(len(bytes.fromhex(READ_TEN)))
    await wired.says(each.early)
    await asyncio.sleep(max(0.0, ends_at + each.delay - loop.time()))
    own = bytes.fromhex("03 14") + bytes((len(answers) % 256,)) * 20
    for byte in each.data.replace(TEN, encode(1, own)):
        await asyncio.sleep(character * 0.9999)
        wired.memory.deliver(bytes((byte,)))
    said = loop.time()
    while len(answers) == known:  # noqa: ASYNC110 - in virtual time
        await asyncio.sleep(0.0005)
    late = loop.time() - said
    await asyncio.sleep(0.01 + wired.driver.line.settings.silence_before_request)
    return Asked(answers[known] or "", own.hex(" ").upper(), wired.user.wakes - wakes, late)


async def talks(wired: Wired, *each: Talk) -> list[Asked]:
    return [await talk(wired, one) for one in each]


@pytest.mark.parametrize("virtual", [True, False])
@pytest.mark.parametrize(("baud", "wakes"), [(1200, 8), (9600, 2), (19200, 2), (115200, 2)])
async def test_a_usual_answer_is_first_looked_for_when_it_should_be_there(baud: int, wakes: int, virtual: bool) -> None:
    """At 1200 baud a look each 50 ms is for ports that are lost."""
    async with Wired(LineTiming("rtu", baud, CharacterFormat.parse("8N1")), virtual=virtual) as wired:
        first, *others = await talks(wired, *[Talk()] * 12)
        assert first.wakes >= 4
        assert sum(asked.wakes for asked in others) <= wakes * len(others)
        assert max(asked.late for asked in others) < CHARACTER + 0.0005


async def test_a_device_that_has_become_faster_is_noticed_within_a_few_answers() -> None:
    async with Wired() as wired:
        await talks(wired, *[Talk(delay=0.03)] * 3)
        faster = await talks(wired, *[Talk(delay=0.004)] * 14)
        assert [asked.answer[:5] for asked in faster] == ["03 14"] * 14
        assert max(asked.late for asked in faster) < 0.03
        assert max(asked.late for asked in faster[-4:]) < 3 * CHARACTER


async def test_a_device_that_has_become_slower_is_answered_on_its_last_byte() -> None:
    async with Wired() as wired:
        await talks(wired, *[Talk()] * 3)
        slower = await talks(wired, *[Talk(delay=0.006)] * 40)
        assert max(asked.late for asked in slower) < CHARACTER + 0.0005
        assert slower[-1].wakes <= 3


@pytest.mark.parametrize("baud", [9600, 19200, 115200])
@pytest.mark.parametrize("cycle", [0.002, 0.01, 0.02])
async def test_a_device_that_answers_in_its_own_cycle_is_answered_hardly_later(baud: int, cycle: float) -> None:
    """A controller answers at the end of its cycle, and knows nothing of when it is asked."""
    async with Wired(LineTiming("rtu", baud, CharacterFormat.parse("8N1"))) as wired:
        delays = [0.004 + cycle * (each * 0.618034 % 1.0) for each in range(200)]
        late = [asked.late for asked in await talks(wired, *[Talk(delay=delay) for delay in delays])]
        assert sum(late[20:]) / len(late[20:]) < 0.0003


async def test_an_exception_is_seen_when_the_answer_should_have_been_there_and_the_next_one_as_it_comes() -> None:
    async with Wired() as wired:
        await talks(wired, Talk(), Talk())
        first, second, normal = await talks(wired, Talk(EXCEPTION), Talk(EXCEPTION), Talk())
        assert first.answer == second.answer == "83 02"
        assert 10 * CHARACTER < first.late < 21 * CHARACTER
        assert second.late < 0.0006
        assert normal.late < 0.0006


@pytest.mark.parametrize(
    "disturbance",
    [
        Talk(b""),
        Talk(TEN[:20]),
        Talk(TEN[:-1] + b"\x00"),
        Talk(early=b"\x55"),
        Talk(b"\x55" + TEN),
        Talk(TEN + b"\x55"),
        Talk(TEN + TEN),
        Talk(OTHERS + TEN),
        Talk(EXCEPTION),
    ],
    ids=repr,
)
async def test_after_anything_unusual_the_next_answer_is_looked_for_at_once(disturbance: Talk) -> None:
    async with Wired(virtual=False) as wired:
        await talks(wired, Talk(), Talk())
        await talk(wired, disturbance)
        await asyncio.sleep(5.0)
        now = wired.loop.time()
        wired.device.submit(wired.client.ask(READ_TEN, now=now), now)
        assert wired.driver._read_at is None


@pytest.mark.parametrize("before", [b"\x55", OTHERS, TEN, OF_ANOTHER], ids=bytes.hex)
async def test_if_something_has_come_since_the_last_answer_nobody_looks_away(before: bytes) -> None:
    async with Wired(virtual=False) as wired:
        await talks(wired, Talk(), Talk())
        await wired.says(before)
        await asyncio.sleep(0.1)
        now = wired.loop.time()
        wired.device.submit(wired.client.ask(READ_TEN, now=now), now)
        assert wired.driver._read_at is None


#: What comes while a request is being sent, and what its device says then: the first is a copy of the last answer.
TWICE = {
    "and the answer": Talk(TEN, 0.0004, early=TEN),
    "noise and the answer": Talk(b"\x55" + TEN, 0.0004, early=TEN),
    "noise and no answer yet": Talk(TEN, 0.06, early=TEN + b"\x55"),
    "after noise": Talk(TEN, 0.06, early=b"\x55" + TEN),
    "another unit's and the answer": Talk(OF_ANOTHER + TEN, 0.0004, early=TEN),
    "and an exception": Talk(EXCEPTION, 0.0004, early=TEN),
    "and the answer later": Talk(TEN, 0.024, early=TEN),
    "and the answer much later": Talk(TEN, 0.1, early=TEN),
}


@pytest.mark.parametrize("delay", [0.0003, 0.004, 0.007, 0.012, 0.035])
@pytest.mark.parametrize("twice", TWICE.values(), ids=TWICE)
async def test_a_device_that_answers_twice_for_the_first_time_is_not_believed(twice: Talk, delay: float) -> None:
    """Its second answer comes while the next request is being sent, whatever comes then."""
    async with Wired(virtual=False) as wired:
        await talks(wired, *[Talk(delay=delay)] * 5)
        asked, following = await talks(wired, twice, Talk(delay=delay))
        assert asked.answer in ("83 0B", asked.own, "83 02")
        assert (asked.answer == "83 02") <= (twice.data == EXCEPTION)
        assert following.answer in ("83 0B", following.own)


@pytest.mark.interpreted
@pytest.mark.parametrize("late", [0.1, 1.0, 4.0])
@pytest.mark.parametrize("twice", TWICE.values(), ids=TWICE)
async def test_nor_is_it_if_the_gateway_looks_late(twice: Talk, late: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Timers come 0.05 ms late, and much later on a loaded machine: the request is complete then."""
    monkeypatch.setattr("gateway.lines.pacing._BEFORE_ITS_END", -late)
    async with Wired(virtual=False) as wired:
        await talks(wired, *[Talk(delay=0.012)] * 5)
        asked, following = await talks(wired, twice, Talk(delay=0.012))
        assert asked.answer in ("83 0B", asked.own, "83 02")
        assert following.answer in ("83 0B", following.own)


@pytest.mark.interpreted
@pytest.mark.parametrize("late", [1.0, 8.0, 25.0, 40.0])
@pytest.mark.parametrize("delay", [0.0, 0.0003, 0.004])
async def test_an_answer_that_has_begun_when_the_gateway_looks_late_is_one(
    delay: float, late: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with Wired(virtual=False) as wired:
        await talks(wired, *[Talk(delay=0.035)] * 3)
        monkeypatch.setattr("gateway.lines.pacing._BEFORE_ITS_END", -late)
        asked = await talk(wired, Talk(delay=delay))
        assert asked.answer == asked.own


@pytest.mark.parametrize("disturbance", [Talk(before=b"\x55"), Talk(early=b"\x55")], ids=["before", "early"])
async def test_after_anything_that_is_no_answer_nobody_looks_away_for_a_minute(disturbance: Talk) -> None:
    async with Wired(virtual=False) as wired:
        await talks(wired, Talk(), Talk(), disturbance, Talk())
        for pause, is_foreseen in [(CALM / 2, False), (CALM / 2, True)]:
            await asyncio.sleep(pause)
            asked = await talk(wired, Talk())
            assert (asked.wakes <= 2) == is_foreseen


@pytest.mark.parametrize(
    "pdu", ["06 00 01 00 05", "01 03 00 00 18"], ids=["a write", "a read whose response may be its echo"]
)
async def test_what_an_echo_could_answer_is_not_foreseen(pdu: str) -> None:
    request = encode(1, bytes.fromhex(pdu))
    async with Wired(virtual=False) as wired:
        for _ in range(3):
            await wired.asks(pdu)
            assert wired.driver._read_at is None
            await wired.says(request)
            await asyncio.sleep(0.1)
        assert len(wired.client.answers) == 3


async def test_another_request_of_the_same_kind_is_foreseen_and_one_of_another_size_is_not() -> None:
    async with Wired() as wired:
        await talks(wired, Talk(), Talk())
        for pdu, is_foreseen in [("03 00 20 00 0A", True), ("03 00 20 00 05", False)]:
            await wired.asks(pdu)
            assert (wired.driver._read_at is not None) == is_foreseen
            count = bytes.fromhex(pdu)[-1]
            await wired.says(encode(1, bytes((3, 2 * count)) + bytes(2 * count)))
            await asyncio.sleep(0.1)


async def test_a_long_answer_is_first_looked_for_when_it_could_be_an_exception() -> None:
    most = encode(1, bytes.fromhex("03 FA") + bytes(250))
    async with Wired() as wired:
        for said, latest in [(most, 0.0), (most, CHARACTER), (most, CHARACTER), (EXCEPTION, CHARACTER)]:
            wakes = wired.user.wakes
            await wired.asks("03 00 00 00 7D")
            await asyncio.sleep(0.004)
            await wired.says(said)
            known = len(wired.client.answers)
            await asyncio.sleep(2 * CHARACTER)
            assert len(wired.client.answers) >= known
            if latest and said is most:
                assert wired.user.wakes - wakes <= 2 + 256 * CHARACTER / LONGEST + 2
            await asyncio.sleep(0.1)
        assert [answer[:5] for answer in wired.client.answers] == ["03 FA"] * 3 + ["83 02"]


async def test_a_server_that_brings_a_response_as_a_whole_may_be_quick_at_last() -> None:
    """Where `wire` says that a real line is behind a network, and its rate is not what the config says."""
    wired = Wired(virtual=False, looks_away=False)
    wired.memory.has_arrived = lambda: True
    async with wired:
        for delay in (0.03, 0.03, 0.03, 0.003):
            now = wired.loop.time()
            wired.device.submit(wired.client.ask(READ_TEN, now=now), now)
            await asyncio.sleep(REQUEST_TIME + delay)
            wired.memory.deliver(TEN)
            await asyncio.sleep(0.2)
        assert [answer[:5] for answer in wired.client.answers] == ["03 14"] * 4


async def test_a_lost_port_is_looked_at_though_the_answer_is_not_expected_yet() -> None:
    async with Wired() as wired:
        await talks(wired, Talk(delay=0.15), Talk(delay=0.15))
        now = wired.loop.time()
        wired.device.submit(wired.client.ask(READ_TEN, now=now), now)
        assert wired.driver._read_at == pytest.approx(now + LONGEST)


async def test_between_an_answer_and_the_next_request_that_waits_the_port_is_read_once() -> None:
    async with Wired() as wired:
        await talks(wired, Talk(), Talk())
        for _ in range(2):
            now = wired.loop.time()
            wired.device.submit(wired.client.ask(READ_TEN, now=now), now)
        await asyncio.sleep(REQUEST_TIME + 0.004)
        await wired.says(TEN)
        gap = wired.driver.line.settings.silence_before_request
        wired.memory.take_written()
        wakes = wired.user.wakes
        await asyncio.sleep(gap / 3)
        wired.memory.deliver(b"\x55")
        assert wired.user.wakes == wakes
        noise_at = wired.loop.time()
        while not wired.memory.written:  # noqa: ASYNC110 - in virtual time
            await asyncio.sleep(CHARACTER / 16)
        assert wired.loop.time() - noise_at > gap  # the noise is heard before anything is sent, and silence follows


#: What a device may say, what may come before and during a request, and how long a device thinks, in seconds.
SAID = st.sampled_from(
    [*[TEN] * 4, EXCEPTION, b"", TEN[:12], TEN + b"\x55", b"\x55\x55" + TEN, OF_ANOTHER + TEN, TEN + TEN]
)
NOISE = st.sampled_from([*[b""] * 5, b"\x55\xaa", b"\x01", TEN[:4], OTHERS, OF_ANOTHER])
EARLY = st.one_of(NOISE, st.sampled_from([ANOTHER + TEN, ANOTHER + EXCEPTION, OTHERS + OF_ANOTHER, EXCEPTION[:3]]))
#: A copy of the last answer, which a virtual port has no time for.
COPY = st.sampled_from([TEN, TEN + b"\x55", b"\x55" + TEN])
DELAYS = st.sampled_from([0.002, 0.002, 0.002, 0.004, 0.011, 0.04, 0.12])


def conversations(early: st.SearchStrategy[bytes]) -> st.SearchStrategy[list[Talk]]:
    """A device that has habits, on a line that is calm, and then anything happens; a few times."""
    steady = st.lists(st.builds(Talk, delay=DELAYS), min_size=1, max_size=3)
    anything = st.lists(st.builds(Talk, data=SAID, delay=DELAYS, before=NOISE, early=early), min_size=1, max_size=8)
    return st.builds(_mixed, steady, anything)


def _mixed(steady: list[Talk], anything: list[Talk]) -> list[Talk]:
    return [each for habit in steady for each in (Talk(delay=habit.delay, calm=CALM + 1.0), habit, habit, *anything)]


@pytest.mark.search
@pytest.mark.parametrize("virtual", [True, False], ids=["virtual", "real"])
@given(chance=st.data())
def test_whoever_foresees_hears_the_same_and_hardly_later(virtual: bool, chance: st.DataObject) -> None:
    """On a virtual port, which is not read while a request is sent, others are heard later."""
    said = chance.draw(conversations(st.just(b"") if virtual else EARLY | COPY))
    away, here = (outcome(said, virtual=virtual, looks_away=looks_away) for looks_away in (True, False))
    assert [each.answer for each in away[0]] == [each.answer for each in here[0]]
    assert away[1:] == here[1:]
    assert max(each.late for each in away[0] if each.answer != "83 0B") < LONGEST + 0.002


@pytest.mark.search
@given(said=conversations(EARLY | COPY))
def test_whatever_comes_before_a_request_is_complete_its_answer_is_its_own(said: list[Talk]) -> None:
    asked, *_ = outcome(said, virtual=False, looks_away=True)
    assert {each.answer for each in asked if each.answer != each.own} <= {"83 0B", "83 02"}


def outcome(said: list[Talk], *, virtual: bool, looks_away: bool) -> tuple[list[Asked], object, object, object]:
    """What became of each request, what the line has counted and told, and what it has written."""

    async def all_of_it() -> tuple[list[Asked], object, object, object]:
        async with Wired(virtual=virtual, looks_away=looks_away) as wired:
            asked = await talks(wired, *said)
            counts = {function: repr(each) for function, each in wired.device.counts.items()}
            return asked, counts, [type(event) for event in wired.events], wired.memory.take_written()

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(all_of_it())
