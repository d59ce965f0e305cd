"""Two gateways whose lines name one lease: one asks, the other one takes over where it has left off."""

import asyncio
from types import SimpleNamespace

import pytest

from gateway.errors import FleetError, WrongQuestion
from gateway.events import LateResponse, LeaseLost, LeaseTaken, LineLost
from gateway.operator.status.metrics import read
from gateway.operator.units.forgetting import forget
from gateway.runtime.fleet.add_on import Fleet
from gateway.runtime.gateway import Gateway
from gateway.runtime.running import Running
from gateway.state.memory import Memory
from kit.gateway_bench import GatewayBench, gateway_bench
from kit.statuses import status

CONFIG = """
site = "{site}"
[fleet]
servers = ["nats://127.0.0.1:4222"]
lease = "5 s"
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
baud    = 9600
lease   = "hall-a"
devices = [{{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }}]
"""
READ_7 = "03 0007 0001"
MOVE_TO_5 = ("01 10 01 00 00 01 02 00 05 76 93", "05 10 01 00 00 01 01 B1")
MOVE_TO_1 = ("05 10 01 00 00 01 02 00 01 45 90", "01 10 01 00 00 01 00 35")
TO_19200 = ("01 10 02 00 00 02 04 46 96 00 00 1F AB", "01 10 02 00 00 02 40 70")
#: Of somebody else on the line: a read of register 1 of unit 9.
STRANGER = bytes.fromhex("09 03 00 01 00 01 D4 82")
#: Longer than a lease and any late window here, in seconds.
LONG = 20.0


class KeyValues:
    """The bucket of leases. `is_away`: NATS cannot be reached."""

    def __init__(self) -> None:
        self.entries: dict[str, tuple[bytes, int]] = {}
        self.is_away = False

    async def get(self, key: str) -> SimpleNamespace | None:
        value, revision = self.entries.get(key, (None, 0))
        return SimpleNamespace(value=value, revision=revision) if revision else None

    async def create(self, key: str, value: bytes) -> int | None:
        return await self.update(key, value, 0)

    async def update(self, key: str, value: bytes, revision: int) -> int | None:
        if self.entries.get(key, (b"", 0))[1] != revision:
            return None
        self.entries[key] = (value, revision + 1)
        return revision + 1


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> KeyValues:
    """The bucket of both gateways, and their clock, which is that of the event loop."""
    store = KeyValues()

    async def bucket(fleet: Fleet, name: str) -> KeyValues:
        if store.is_away:
            raise FleetError("NATS cannot be reached: it is away")
        return store

    async def connect(fleet: Fleet, gateway: Gateway) -> None:
        """There is no NATS."""

    monkeypatch.setattr(Fleet, "bucket", bucket)
    monkeypatch.setattr(Fleet, "connect", connect)
    monkeypatch.setattr("gateway.fleet.standby.clock_gettime", lambda _: 1000.0 + asyncio.get_running_loop().time())
    return store


def told(bench: GatewayBench, kind: type) -> list:
    return [event for event in bench.events if isinstance(event, kind)]


def is_open(bench: GatewayBench) -> bool:
    """Whether its port is open; one that was never open is not there."""
    return "hall-a" in bench.lines and bench.lines["hall-a"].is_open


def config(site: str, more: str = "") -> str:
    return CONFIG.format(site=site) + more


def rebuilt(bench: GatewayBench, text: str) -> Gateway:
    """The gateway of another config, with what is the same in both."""
    return bench.rebuilt(text)


async def exchange(bench: GatewayBench, request: str, response: str) -> str:
    """Unit 41 is asked; the request must be on the line as it is printed, and gets the printed response."""
    client, line = bench.client(), bench.lines["hall-a"]
    client.ask(41, request[3:-6])
    await asyncio.sleep(0.2)
    assert line.take_written().hex(" ").upper() == request
    line.deliver(bytes.fromhex(response))
    return await client.answer()


async def test_one_asks_and_the_other_one_answers_0a_with_its_port_closed(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(LONG)
            assert (is_open(one), is_open(other)) == (True, False)
            assert await other.client().asks(41, READ_7) == "83 0A"
            one.client().ask(41, READ_7)
            await asyncio.sleep(0.1)
            assert one.lines["hall-a"].take_written()
            assert not told(other, LineLost), "a port that is closed on purpose is not lost"


async def test_status_and_metrics_say_who_holds_it(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one, gateway_bench(config("b")) as other:
        await asyncio.sleep(LONG)
        holder, standby = (one, other) if is_open(one) else (other, one)
        first, second = status(holder.running), status(standby.running)
        assert (first.lines[0].state, second.lines[0].state) == ("up", "standby")
        assert second.lines[0].reason.startswith("standby for the lease hall-a: ")
        (held,), (waits) = first.leases, second.leases[0]
        assert (held.line, held.name, held.is_held, waits.is_held) == ("hall-a", "hall-a", True, False)
        assert (held.holder, held.taken, waits.taken) == (waits.holder, 1, 0)
        values = [family.values for family in await read(other.running) if family.name == "lease_held"]
        assert values == [[(("hall-a", "hall-a"), is_open(other))]]


async def test_after_a_stop_the_other_one_goes_on_with_moved_devices_and_without_a_silence(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        assert await exchange(one, *MOVE_TO_5) == "10 01 00 00 01"
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            await one.running.ports.end([one.gateway.lines[0]])
            assert not is_open(one)
            await asyncio.sleep(0.6)
            assert [event.silent_s for event in told(other, LeaseTaken)] == [0.0]
            other.client().ask(41, READ_7)
            await asyncio.sleep(0.1)
            assert other.lines["hall-a"].take_written()[0] == 5


async def test_who_knows_nothing_of_a_device_that_has_moved_does_not_let_others_forget_it(store: KeyValues) -> None:
    memory = Memory()
    memory.remember("/dev/hall-a silo-1", 1, 5)
    async with gateway_bench(config("b")) as other:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("a"), memory) as one:
            await asyncio.sleep(1.0)
            await other.running.ports.end([other.gateway.lines[0]])
            await asyncio.sleep(0.6)
            one.client().ask(41, READ_7)
            await asyncio.sleep(0.1)
            assert one.lines["hall-a"].take_written()[0] == 5


async def test_a_device_that_has_moved_back_is_asked_there_by_the_other_one(store: KeyValues) -> None:
    memory = Memory()
    memory.remember("/dev/hall-a silo-1", 1, 5)
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        await exchange(one, *MOVE_TO_5)
        await exchange(one, *MOVE_TO_1)
        async with gateway_bench(config("b"), memory) as other:
            await asyncio.sleep(1.0)
            await one.running.ports.end([one.gateway.lines[0]])
            await asyncio.sleep(0.6)
            other.client().ask(41, READ_7)
            await asyncio.sleep(0.1)
            assert other.lines["hall-a"].take_written()[0] == 1


@pytest.mark.parametrize("unit", [1, 250])
async def test_a_device_that_may_have_moved_is_asked_at_both_addresses_by_the_other_one(
    store: KeyValues, unit: int
) -> None:
    configs = [config(site).replace("unit = 1,", f"unit = {unit},") for site in ("a", "b")]
    async with gateway_bench(configs[0]) as one:
        await asyncio.sleep(LONG)
        assert await one.client().asks(41, MOVE_TO_5[0][3:-6]) == "90 0B"
        async with gateway_bench(configs[1]) as other:
            await asyncio.sleep(1.0)
            await one.running.ports.end([one.gateway.lines[0]])
            await asyncio.sleep(10.0)
            assert other.gateway.lines[0].devices[41].address.units == (unit, 5)


async def test_only_who_holds_the_lease_forgets(store: KeyValues) -> None:
    memory = Memory()
    memory.remember("/dev/hall-a silo-1", 1, 5)
    async with gateway_bench(config("a"), memory) as one:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            with pytest.raises(WrongQuestion, match="another gateway has the lease of hall-a"):
                forget(other.gateway, "silo-1", other.events.append)
            forget(one.gateway, "silo-1", one.events.append)
            await asyncio.sleep(1.0)
            await one.running.ports.end([one.gateway.lines[0]])
            await asyncio.sleep(10.0)
            assert other.gateway.lines[0].devices[41].address.units == (1,)


async def test_a_rate_that_was_changed_moves_too(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        assert await exchange(one, *TO_19200) == "10 02 00 00 02"
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            await one.running.ports.end([one.gateway.lines[0]])
            await asyncio.sleep(0.6)
            assert is_open(other)
            assert other.opened["hall-a"].baud == 19200
            assert other.gateway.lines[0].driver.line.settings.timing.baud == 19200


async def test_a_late_answer_to_the_other_one_is_not_believed(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            client = one.client()
            assert await client.asks(41, READ_7) == "83 0B"
            await one.running.ports.end([one.gateway.lines[0]])
            await asyncio.sleep(0.6)
            assert is_open(other)
            assert other.gateway.lines[0].driver.line.ledger.count_late(asyncio.get_running_loop().time()) == 1
            asker = other.client()
            assert await asker.asks(41, READ_7) == "83 0B", "the same function of that unit is not asked meanwhile"
            assert not other.lines["hall-a"].take_written()
    assert not told(other, LateResponse)


async def test_who_was_killed_is_followed_after_its_lease_and_a_silence(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            entries = dict(store.entries)
            await one.running.ports.end([one.gateway.lines[0]])
            value, revision = entries["hall-a"]
            store.entries["hall-a"] = (value, revision)  # it did not come to give it back
            while not told(other, LeaseTaken):  # noqa: ASYNC110 - virtual time
                await asyncio.sleep(0.1)
            (taken,) = told(other, LeaseTaken)
            assert taken.silent_s > 0.5
            await asyncio.sleep(max(0.0, taken.silent_s - 1.0))
            other.client().ask(41, READ_7)
            await asyncio.sleep(min(1.0, taken.silent_s) - 0.2)
            assert not other.lines["hall-a"].take_written()
            await asyncio.sleep(0.5)
            assert other.lines["hall-a"].take_written()


async def test_without_nats_nobody_asks_and_requests_get_0a(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        store.is_away = True
        await asyncio.sleep(5.0)
        assert not is_open(one)
        assert await one.client().asks(41, READ_7) == "83 0A"
        (lost,) = told(one, LeaseLost)
        assert "NATS cannot be reached: it is away" in lost.reason
        store.is_away = False
        await asyncio.sleep(2.0)
        assert is_open(one)


async def test_with_fallback_hold_it_goes_on_without_nats(store: KeyValues) -> None:
    async with gateway_bench(config("a").replace('"5 s"', '"5 s"\nfallback = "hold"')) as one:
        await asyncio.sleep(LONG)
        store.is_away = True
        await asyncio.sleep(LONG)
        one.client().ask(41, READ_7)
        await asyncio.sleep(0.1)
        assert one.lines["hall-a"].take_written()


async def test_who_hears_another_asker_closes_its_port_and_sends_nothing_more(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        one.lines["hall-a"].deliver(STRANGER)
        await asyncio.sleep(0.1)
        assert not is_open(one)
        assert await one.client().asks(41, READ_7) == "83 0A"
        assert [event.reason for event in told(one, LeaseLost)] == ["another client was heard on the line"]
        await asyncio.sleep(4.0)
        assert not is_open(one)
        await asyncio.sleep(3.0)
        assert is_open(one)


async def test_a_request_is_refused_when_the_share_has_ended_though_nobody_could_act_on_that(store: KeyValues) -> None:
    """As behind SIGSTOP: the first that happens is a request."""
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        standby = one.gateway.lines[0].standby
        assert standby is not None
        standby.lease.until = 0.0
        client = one.client()
        assert await client.asks(41, READ_7) == "83 0A"
        assert not one.lines["hall-a"].take_written()


async def test_who_cannot_open_the_port_lets_the_other_one_ask(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            one.lines["hall-a"].pull()
            await asyncio.sleep(8.0)
            assert is_open(other)
            one.lines["hall-a"].plug()
            await asyncio.sleep(LONG)
            assert (is_open(one), is_open(other)) == (False, True)


async def test_the_port_is_not_lent(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        running: Running = one.running
        with pytest.raises(WrongQuestion, match="others may ask there"):
            async with running.ports.lent(one.gateway.lines[0], "a test"):
                pass


async def test_a_reload_that_gives_the_line_another_lease_gives_the_old_one_back(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        async with gateway_bench(config("b")) as other:
            await asyncio.sleep(1.0)
            await one.running.switch(rebuilt(one, config("a").replace('lease   = "hall-a"', 'lease   = "hall-b"')))
            await asyncio.sleep(1.0)
            assert [event.silent_s for event in told(other, LeaseTaken)] == [0.0]
            assert not is_open(one)
            await asyncio.sleep(LONG)
            assert is_open(one)


async def test_a_reload_that_does_not_touch_the_line_leaves_its_lease_alone(store: KeyValues) -> None:
    async with gateway_bench(config("a")) as one:
        await asyncio.sleep(LONG)
        line = one.gateway.lines[0]
        await one.running.switch(rebuilt(one, config("a", "[[image]]\nunit = 200\nholding = 1\n")))
        await asyncio.sleep(1.0)
        assert one.running.gateway.lines == (line,)
        assert len(told(one, LeaseTaken)) == 1
