"""Who keeps a port open while the lease is held: what becomes of drivers that hang, and of defects."""

import asyncio
from types import SimpleNamespace

import pytest

from gateway.errors import FleetError, PortError
from gateway.events import Event, LeaseLost, LeaseTaken
from gateway.fleet.lease import LeaseSettings
from gateway.fleet.lease_entry import State
from gateway.fleet.standby import Standby

SETTINGS = LeaseSettings("hall-a", ttl=5.0, guard=1.0, late=1.0)


class Bucket:
    """It has one entry. `hangs`: no call returns. `is_gone`: it was deleted."""

    def __init__(self) -> None:
        self.entry: tuple[bytes, int] | None = None
        self.calls = 0
        self.hangs = False
        self.is_gone = False

    async def __call__(self) -> "Bucket":
        self.calls += 1
        if self.hangs:
            await asyncio.Event().wait()
        if self.is_gone:
            raise FleetError("there is no bucket mbgw-lease")
        return self

    async def get(self, key: str) -> SimpleNamespace | None:
        return None if self.entry is None else SimpleNamespace(value=self.entry[0], revision=self.entry[1])

    async def create(self, key: str, value: bytes) -> int | None:
        return await self.update(key, value, 0)

    async def update(self, key: str, value: bytes, revision: int) -> int | None:
        if (0 if self.entry is None else self.entry[1]) != revision:
            return None
        self.entry = (value, revision + 1)
        return revision + 1


class Line:
    """A line whose port takes `closes_in` seconds to close."""

    def __init__(self) -> None:
        self.closes_in = 0.0
        self.opened = 0
        self.open_now = 0
        self.defect: Exception | None = None
        self.is_usable = True
        self.withheld = ""

    async def keep_open(self) -> None:
        self.opened += 1
        self.open_now += 1
        assert self.open_now == 1
        try:
            if self.defect is not None:
                raise self.defect
            await asyncio.Event().wait()
        finally:
            await asyncio.sleep(self.closes_in)
            self.open_now -= 1

    def withhold(self, reason: PortError) -> None:
        self.withheld = str(reason)

    def state(self) -> State:
        return {}

    def adopt(self, state: State) -> None:
        assert state == {}, "nobody has left anything"

    def final_state(self) -> State:
        return {}


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """One standby, its line and its bucket."""
    monkeypatch.setattr("gateway.fleet.standby.clock_gettime", lambda _: 1000.0 + asyncio.get_running_loop().time())
    line, bucket, events = Line(), Bucket(), list[Event]()
    standby = Standby("hall-a", SETTINGS, "a", bucket, line, events.append)
    return SimpleNamespace(line=line, bucket=bucket, events=events, standby=standby)


def told(bench: SimpleNamespace) -> list[str]:
    return [event.name for event in bench.events if isinstance(event, LeaseTaken | LeaseLost)]


async def test_a_port_that_takes_long_to_close_is_not_opened_again_before_that(bench: SimpleNamespace) -> None:
    running = asyncio.create_task(bench.standby.run())
    await asyncio.sleep(10.0)
    assert bench.line.open_now == 1
    bench.line.closes_in = 8.0
    bench.standby.lease.give_way(1000.0 + asyncio.get_running_loop().time(), "for this test")
    await asyncio.sleep(6.0)
    assert (bench.standby.lease.is_held, bench.line.opened) == (True, 1)
    bench.line.closes_in = 0.0
    await asyncio.sleep(6.0)
    assert (bench.standby.lease.is_held, bench.line.opened, bench.line.open_now) == (True, 2, 1)
    assert told(bench) == ["lease_taken", "lease_lost", "lease_taken"]
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert told(bench)[-1] == "lease_lost"


async def test_a_defect_gives_the_lease_back_and_is_passed_on(bench: SimpleNamespace) -> None:
    bench.line.defect = ValueError("a defect")
    with pytest.raises(ValueError, match="a defect"):
        await bench.standby.run()
    assert bench.bucket.entry is not None
    assert b'"is_released": true' in bench.bucket.entry[0]


async def test_a_store_that_never_answers_holds_up_nothing(bench: SimpleNamespace) -> None:
    running = asyncio.create_task(bench.standby.run())
    await asyncio.sleep(10.0)
    bench.bucket.hangs = True
    calls = bench.bucket.calls
    await asyncio.sleep(10.0)
    assert bench.line.open_now == 0
    assert "NATS did not answer within" in bench.standby.lease.trouble
    assert calls < bench.bucket.calls < calls + 25
    stopped_at = asyncio.get_running_loop().time()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    assert asyncio.get_running_loop().time() < stopped_at + 1.0


async def test_an_error_of_the_store_is_the_reason(bench: SimpleNamespace) -> None:
    async def refuse() -> Bucket:
        raise FleetError("it has no JetStream")

    standby = Standby("hall-a", SETTINGS, "a", refuse, bench.line, bench.events.append)
    running = asyncio.create_task(standby.run())
    await asyncio.sleep(1.0)
    assert bench.line.withheld == "standby for the lease hall-a: it has no JetStream"
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_a_bucket_that_was_deleted_and_made_again_is_used_without_help(bench: SimpleNamespace) -> None:
    lines = [bench.line, Line()]
    other = Standby("hall-a", SETTINGS, "b", bench.bucket, lines[1], bench.events.append)
    running = [asyncio.create_task(each.run()) for each in (bench.standby, other)]
    await asyncio.sleep(10.0)
    for gone_for in (0.0, 0.5, 4.0, 20.0):
        bench.bucket.entry, bench.bucket.is_gone = None, True
        await asyncio.sleep(gone_for)
        bench.bucket.is_gone = False
        for _ in range(100):
            await asyncio.sleep(0.1)
            assert sum(line.open_now for line in lines) <= 1
            assert not (bench.standby.may_send() and other.may_send())
        assert bench.standby.lease.is_held is not other.lease.is_held
    for each in running:
        each.cancel()
    await asyncio.gather(*running, return_exceptions=True)


@pytest.mark.parametrize("value", [b"[" * 60_000, b'{"holder": "b", "instance": "", "beat": 1, "ttl": 1e999}'])
async def test_an_entry_that_cannot_be_read_ends_nothing_and_is_replaced(bench: SimpleNamespace, value: bytes) -> None:
    running = asyncio.create_task(bench.standby.run())
    await asyncio.sleep(10.0)
    bench.bucket.entry = (value, 1000)
    await asyncio.sleep(3.0)
    assert (bench.line.open_now, told(bench)) == (0, ["lease_taken", "lease_lost"])
    assert "whose entry cannot be read has taken it" in bench.events[-1].reason
    assert "whose entry cannot be read holds it" in bench.line.withheld
    await asyncio.sleep(6.0)
    assert (bench.line.open_now, told(bench)[-1]) == (1, "lease_taken")
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
