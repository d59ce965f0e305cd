"""The supervisor: it starts all parts, keeps the defect of one from the others, and stops in bounded, virtual time."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import replace

import pytest

from gateway.errors import ListenError
from gateway.events import Event, LineLost, LineUp, PartFailed, Ready
from gateway.runtime.add_on import AddOn
from gateway.runtime.gateway import Gateway
from gateway.service.supervisor import Stop, serve
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench

CONFIG = """
[[line]]
name = "hall-a"
port = "/dev/hall-a"
devices = [{ unit = 1 }]

[[line]]
name = "hall-b"
port = "/dev/hall-b"
devices = [{ unit = 2 }]
"""
READ = "03 00 00 00 01"
NEVER = 1e6


class FakeListener:
    """A listener without sockets: notes what it is told.

    Its address is known `found_in` seconds after `find`, or it is `nowhere`; its clients are gone `drains_in` seconds
    after `finish`.
    """

    sockets = ()

    def __init__(
        self, drains_in: float = 0.0, error: Exception | None = None, *, found_in: float = 0.0, nowhere: bool = False
    ) -> None:
        self.address = "tcp://127.0.0.1:502"
        self.clients = 0
        self.told: list[str] = []
        self._error = error
        self._found_in, self._is_nowhere = found_in, nowhere
        self._drains_in = drains_in
        self._gone_at = NEVER

    @property
    def has_clients(self) -> bool:
        return asyncio.get_running_loop().time() < self._gone_at

    async def find(self) -> None:
        self.told.append("find")
        await asyncio.sleep(self._found_in)
        if self._is_nowhere:
            raise ListenError("nobody knows the name")

    def bind(self, ready=None) -> None:
        self.told.append("bind")

    def listen(self) -> None:
        self.told.append("listen")
        if self._error is not None:
            raise self._error

    def start(self) -> None:
        self.told.append("start")

    def finish(self) -> None:
        self.told.append("finish")
        self._gone_at = asyncio.get_running_loop().time() + self._drains_in

    def close(self) -> None:
        self.told.append("close")


class NotedAddOn(AddOn):
    """An add-on that notes what it is `told`, and takes a second to leave."""

    key = "noted"

    def __init__(self, told: list[str]) -> None:
        self._told = told

    async def connect(self, gateway: Gateway) -> None:
        self._told.append("connect")

    async def serve(self, gateway: Gateway) -> None:
        self._told.append("serve")

    async def leave(self) -> None:
        self._told.append("leave")
        await asyncio.sleep(1.0)
        self._told.append("has left")

    async def stop(self) -> None:
        self._told.append("end")

    def status(self) -> object:
        return self


class Service:
    """A gateway that is served, with listeners in the test's hands."""

    def __init__(self, *doors: FakeListener, pages: bool = False) -> None:
        self.bench = GatewayBench(CONFIG)
        self.events: list[Event] = self.bench.events
        self.doors = doors or (FakeListener(),)
        self.client = self.bench.client()
        plan = self.bench.gateway.plan
        plan = replace(plan, listeners=plan.listeners * len(self.doors))
        self.gateway = replace(self.bench.gateway, listeners=self.doors, plan=plan)
        self.stop = Stop()
        running = self.bench.running
        running.apply(self.gateway)
        page = self._page() if pages else None
        self.serving = asyncio.create_task(serve(running, self.stop, pages=page), name="serve")

    @asynccontextmanager
    async def _page(self) -> AsyncIterator[None]:
        self.doors[0].told.append("page")
        yield
        self.doors[0].told.append("page ends")

    def part(self, line: str):
        return next(part for part in self.gateway.parts if part.name == line)

    def open_with(self, line: str, opener: Callable) -> None:
        """Let the port of `line` be opened by `opener`."""
        self.part(line).reconnector._open_port = opener

    async def stops_within(self) -> float:
        """Seconds from the order to stop to the end."""
        loop = asyncio.get_running_loop()
        ordered_at = loop.time()
        self.stop.order("SIGTERM")
        await self.serving
        return loop.time() - ordered_at

    def told(self, kind: type[Event]) -> list[Event]:
        return [event for event in self.events if isinstance(event, kind)]


async def hang(user):
    await asyncio.sleep(NEVER)


async def test_it_is_ready_once_every_line_was_tried_and_clients_can_connect() -> None:
    service = Service()
    service.open_with("hall-b", hang)
    await asyncio.sleep(4.9)
    assert service.doors[0].told == ["find", "bind"]
    await asyncio.sleep(0.2)
    assert service.doors[0].told == ["find", "bind", "listen", "start"]
    assert service.told(Ready) == [Ready(("tcp://127.0.0.1:502",), lines_up=1, lines_down=1)]
    await service.stops_within()


async def test_a_line_that_takes_longer_than_any_other_does_not_keep_clients_of_others_waiting() -> None:
    service = Service()
    service.part("hall-b").reconnector._deadline = NEVER
    service.open_with("hall-b", hang)
    await asyncio.sleep(10.1)
    assert service.doors[0].told == ["find", "bind", "listen", "start"]
    assert service.told(Ready) == [Ready(("tcp://127.0.0.1:502",), lines_up=1, lines_down=1)]
    assert await service.client.asks(2, READ) == "83 0A"
    await service.stops_within()


async def test_the_page_begins_once_the_addresses_of_clients_are_bound_and_ends_last() -> None:
    service = Service(pages=True)
    await asyncio.sleep(1.0)
    assert service.doors[0].told[:3] == ["find", "bind", "page"]
    await service.stops_within()
    assert service.doors[0].told[-2:] == ["close", "page ends"]


async def test_an_add_on_connects_before_clients_can_serves_after_that_and_leaves_while_they_finish() -> None:
    service = Service(FakeListener(drains_in=0.5))
    told = service.doors[0].told
    service.bench.running.add_ons = (NotedAddOn(told),)
    await asyncio.sleep(1.0)
    assert told == ["find", "bind", "connect", "listen", "start", "serve"]
    assert 1.0 <= await service.stops_within() < 1.3
    assert told[6:10] == ["finish", "leave", "has left", "close"]
    assert told[-1] == "end"


async def test_names_are_looked_up_side_by_side() -> None:
    service = Service(FakeListener(found_in=14.0), FakeListener(found_in=14.0))
    await asyncio.sleep(14.5)
    assert service.told(Ready) != []
    await service.stops_within()


async def test_a_name_that_nobody_knows_ends_it() -> None:
    service = Service(FakeListener(), FakeListener(found_in=1.0, nowhere=True))
    with pytest.raises(ListenError, match="nobody knows the name"):
        await service.serving
    assert "bind" not in service.doors[0].told
    assert service.told(LineUp) == []


async def test_an_order_to_stop_does_not_wait_for_name_servers() -> None:
    service = Service(FakeListener(found_in=14.0))
    await asyncio.sleep(0.1)
    assert await service.stops_within() < 0.1
    assert service.told(Ready) == service.told(LineUp) == []
    assert "bind" not in service.doors[0].told


async def test_a_defect_in_opening_a_port_does_not_keep_the_others_from_being_served() -> None:
    service = Service()

    async def defect(user):
        raise RuntimeError("nobody foresaw this")

    service.open_with("hall-a", defect)
    await asyncio.sleep(1)
    service.bench.attach("hall-b", SimulatedLine("rtu", SimulatedDevice(2)))
    assert service.told(Ready) == [Ready(("tcp://127.0.0.1:502",), lines_up=1, lines_down=1)]
    assert service.told(PartFailed)[0].part == "line hall-a"
    assert "nobody foresaw this" in service.told(LineLost)[0].reason
    assert await service.client.asks(2, READ) == "03 02 00 00"
    assert await service.client.asks(1, READ) == "83 0A"
    await service.stops_within()


async def test_a_line_that_met_a_defect_is_started_again() -> None:
    service = Service()
    sound = service.part("hall-a").reconnector._open_port

    async def defect_once(user):
        service.open_with("hall-a", sound)
        raise RuntimeError("nobody foresaw this")

    service.open_with("hall-a", defect_once)
    await asyncio.sleep(3)
    assert service.told(LineUp)[-1].line == "hall-a"
    assert await service.client.asks(1, "03 00 00 00 00") == "83 03"
    await service.stops_within()


async def test_a_stop_asks_no_more_of_clients_than_they_need() -> None:
    service = Service(FakeListener(drains_in=0.5), FakeListener(drains_in=1.0))
    await asyncio.sleep(1)
    assert await service.stops_within() == pytest.approx(1.0, abs=0.1)
    assert [doors.told for doors in service.doors] == [
        ["find", "bind", "listen", "start", "finish", "close", "close"]
    ] * 2
    assert [event.name for event in service.events[-2:]] == ["stopping", "stopped"]


async def test_clients_that_take_for_ever_do_not_hold_up_a_stop() -> None:
    service = Service(FakeListener(drains_in=NEVER))
    await asyncio.sleep(1)
    assert await service.stops_within() == pytest.approx(3.0, abs=0.1)


async def test_a_second_order_waits_for_no_client() -> None:
    service = Service(FakeListener(drains_in=NEVER))
    await asyncio.sleep(1)
    service.stop.order("SIGTERM")
    await asyncio.sleep(0.5)
    assert await service.stops_within() == pytest.approx(0, abs=0.1)


async def test_with_clients_and_a_driver_that_both_hang_a_stop_takes_less_than_five_seconds() -> None:
    service = Service(FakeListener(drains_in=NEVER))
    await asyncio.sleep(1)
    service.bench.lines["hall-a"]._port.wait_closed = asyncio.Event().wait
    assert await service.stops_within() < 4.8
    assert not service.bench.lines["hall-b"].is_open


async def test_a_stop_does_not_wait_for_a_port_that_hangs_at_the_start() -> None:
    service = Service()
    service.open_with("hall-a", hang)
    await asyncio.sleep(1)
    assert await service.stops_within() == pytest.approx(0, abs=0.1)
    assert "start" not in service.doors[0].told
    assert not service.told(Ready)


async def test_an_address_that_is_taken_only_now_ends_the_start_and_closes_all() -> None:
    service = Service(FakeListener(), FakeListener(error=ListenError("taken")))
    with pytest.raises(ListenError, match="taken"):
        await service.serving
    assert [doors.told[-1] for doors in service.doors] == ["close", "close"]
    assert not service.bench.lines["hall-a"].is_open


async def test_cancelled_while_it_looks_up_names_it_leaves_no_task() -> None:
    before = asyncio.all_tasks()
    service = Service(FakeListener(found_in=14.0))
    await asyncio.sleep(1.0)
    service.serving.cancel()
    await asyncio.wait((service.serving,))
    assert asyncio.all_tasks() == before


async def test_a_defect_in_what_runs_beside_is_told_and_all_else_goes_on() -> None:
    service = Service()

    async def defect(gateway: Callable) -> None:
        raise RuntimeError("nobody foresaw this")

    service.bench.running.recent.keep_sampling = defect
    await asyncio.sleep(1.0)
    assert [(told.part, "foresaw" in told.error) for told in service.told(PartFailed)] == [("recent", True)]
    assert await service.client.asks(1, READ) in ("83 0B", "83 0A")
    await service.stops_within()
