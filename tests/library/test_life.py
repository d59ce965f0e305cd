"""The life of an embedded gateway: whatever is cancelled at whatever step, nothing stays behind. In virtual time."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from gateway import Area, CustomUnit, Gateway, LineDown, ListenError, NoResponse
from gateway.errors import RequestError
from gateway.library.life import Life
from gateway.runtime.draining import until
from gateway.service.supervisor import Stop
from kit.pki import listener
from kit.pty import VirtualPort
from kit.stepping_loop import Act, Main, ends_of, run

CONFIG = """
site = "plant"

[[line]]
name = "hall"
port = "{folder}/port"
devices = [{{ unit = 1, name = "silo-1", profile = "weigher" }}]

[[line]]
name = "absent"
port = "/dev/absent"
devices = [{{ unit = 2 }}]

[[image]]
unit = 9
holding = "0-9"

[[listen]]
bind = "tcp://127.0.0.1:0"

[[listen]]
bind = "udp://127.0.0.1:0"
"""
ALL_ELSE = """
[[line]]
name = "programs"
port = "pty:{folder}/link"
role = "server"
serves = "all"

[[line]]
name = "heard"
port = "rtu+tcp://127.0.0.1:1"
role = "monitor"

[[upstream]]
name = "far"
to = "tcp://127.0.0.1:1"
units = [{{ unit = 3 }}]

[[image]]
unit = 20
of = "silo-1"
read = [{{ holding = "0-9", every = "1 s" }}]

[[image]]
unit = 240
name = "all"
map = [{{ at = 0, device = "silo-1", holding = "0-3", every = "1 s" }}]

[[listen]]
bind = "rtu+tcp://127.0.0.1:0"
name = "rtu"

[web]
bind = "http://127.0.0.1:0"

[mqtt]
broker = "mqtt://127.0.0.1:1"
publish = [{{ device = "silo-1", every = "1 s" }}]

[fleet]
servers = ["nats://127.0.0.1:1"]
"""


@pytest.fixture
def config(tmp_path: Path) -> Iterator[str]:
    """A config with a line whose device never answers."""
    with VirtualPort(tmp_path / "port"):
        yield CONFIG.format(folder=tmp_path)


@pytest.fixture
def everything(config: str, tmp_path: Path) -> str:
    """A config with a part of each kind."""
    return config + ALL_ELSE.format(folder=tmp_path) + listener()


class Slow(CustomUnit):
    """A unit that takes half a second, and for ever at address 1."""

    async def read(self, area: Area, address: int, count: int) -> list[int]:
        await asyncio.sleep(0.5 if address == 0 else 1e6)
        return [0] * count


async def live(config: str, *units: int) -> str:
    """Start a gateway, ask units of it, and stop it."""
    async with Gateway.from_text(config, units={60: Slow()}) as gateway:
        async with asyncio.TaskGroup() as group:
            for unit in units:
                group.create_task(ask(gateway, unit))
        assert await gateway.unit(9).read_holding(0, 2) == [0, 0]
    return "through"


async def ask(gateway: Gateway, unit: int) -> None:
    with suppress(RequestError):
        await gateway.unit(unit).read_holding(0)


def cancel(*later: int) -> Callable[[int], Act]:
    """Cancel the main task at a step, and so many steps later."""

    def interfere(at: int) -> Act:
        return lambda step, main: step - at in (0, *later) and main.cancel()

    return interfere


def end_of_loop(at: int) -> Act:
    """Cancel all tasks at a step, as `asyncio.run` does when its main task has ended."""

    def act(step: int, main: Main) -> None:
        for task in asyncio.all_tasks(main.get_loop()) if step == at else ():
            if task.get_name() != "waiting":
                task.cancel()

    return act


CANCELLED = {"once": cancel(), "thrice": cancel(1, 2), "again and again": cancel(2, 5, 11), "loop": end_of_loop}


@pytest.mark.parametrize("cancelled", CANCELLED)
def test_cancelled_at_any_step_nothing_is_left(config, cancelled):
    assert ends_of(partial(live, config, 1, 1, 2), CANCELLED[cancelled]) == []


@pytest.mark.parametrize("every", [13, pytest.param(1, marks=pytest.mark.search)])
def test_of_a_gateway_with_parts_of_each_kind_nothing_is_left(everything, every):
    kinds = list(CANCELLED.values())

    def interfere(at: int) -> Act:
        return kinds[at // every % len(kinds)](at)

    assert ends_of(partial(live, everything, 1, 3, 20, 60, 240), interfere, every) == []


def test_without_an_end_of_its_context_it_ends_with_the_loop(everything):
    async def abandon() -> None:
        gateway = Gateway.from_text(everything)
        await gateway.__aenter__()
        await asyncio.sleep(1.0)
        for task in asyncio.all_tasks():
            if task.get_name() != "waiting":
                task.cancel()
        while len(asyncio.all_tasks()) > 2:  # as `asyncio.run` does
            with suppress(asyncio.CancelledError):
                await asyncio.sleep(0)

    assert run(abandon()).left == []


def test_an_error_in_its_body_comes_out_and_nothing_is_left(config):
    async def fail() -> None:
        async with Gateway.from_text(config) as gateway:
            asyncio.create_task(ask(gateway, 1))  # noqa: RUF006 - it ends with the gateway
            await asyncio.sleep(0)
            raise ZeroDivisionError

    found = run(fail())
    assert isinstance(found.outcome, ZeroDivisionError)
    assert found.left == []


def test_an_address_in_use_is_told_and_nothing_is_left(config):
    async def both() -> None:
        async with Gateway.from_text(config) as first:
            taken = config.replace("udp://127.0.0.1:0", first.addresses[1])
            with pytest.raises(ListenError, match="another program has this port"):
                await Gateway.from_text(taken).__aenter__()
            assert asyncio.current_task().cancelling() == 0
            with pytest.raises(ListenError):
                async with asyncio.timeout(1), Gateway.from_text(taken):
                    pytest.fail("it cannot start")

    found = run(both())
    assert (found.outcome, found.left) == (None, [])


def test_it_runs_once_and_is_used_while_it_runs(config):
    async def misuse() -> None:
        gateway = Gateway.from_text(config)
        with pytest.raises(RuntimeError, match="not running"):
            assert gateway.addresses
        with pytest.raises(RuntimeError, match="not running"):
            await gateway.__aexit__(None, None, None)
        async with gateway:
            with pytest.raises(RuntimeError, match="runs once"):
                await gateway.__aenter__()
            assert await gateway.unit(9).read_holding(0) == [0]
        with pytest.raises(RuntimeError, match="not running"):
            assert gateway.addresses
        with pytest.raises(RuntimeError, match="runs once"):
            await gateway.__aenter__()

    found = run(misuse())
    assert (found.outcome, found.left) == (None, [])


def test_twenty_run_side_by_side(config):
    images = config[config.index("[[image]]") :]

    async def crowd() -> list[str]:
        async with asyncio.TaskGroup() as group:
            ends = [group.create_task(live(images, 9)) for _ in range(20)]
        return [each.result() for each in ends]

    found = run(crowd())
    assert (found.outcome, found.left) == (["through"] * 20, [])


def test_requests_that_are_under_way_when_it_stops_get_an_error(config):
    async def leave() -> None:
        async with Gateway.from_text(config, units={60: Slow()}) as gateway:
            first = asyncio.create_task(gateway.unit(1).read_holding(0))
            second = asyncio.create_task(gateway.unit(1).read_holding(1))
            made = asyncio.create_task(gateway.unit(60).read_holding(1))
            waiting = asyncio.create_task(gateway.unit(60).read_holding(0))
            await asyncio.sleep(0.2)
        with pytest.raises(NoResponse):  # it was sent
            await first
        with pytest.raises(LineDown):
            await second
        for each in (made, waiting):
            with pytest.raises(RequestError):
                await each

    found = run(leave())
    assert (found.outcome, found.left) == (None, [])


# --- a gateway that fails ---


async def failing(after: float) -> None:
    await asyncio.sleep(after)
    raise ZeroDivisionError


def test_a_defect_ends_its_body_and_nothing_is_left(everything, monkeypatch):
    async def defect(*_: object) -> None:
        await asyncio.sleep(1.0)
        raise ZeroDivisionError

    async def wait() -> None:
        async with Gateway.from_text(everything):
            await asyncio.Event().wait()

    monkeypatch.setattr("gateway.runtime.fleet.add_on.Fleet.serve", defect)
    found = run(wait())
    assert isinstance(found.outcome, ZeroDivisionError)
    assert found.left == []


async def test_if_it_fails_its_body_is_cancelled_and_its_end_tells_why():
    life = Life(failing(1.0), Stop())
    with pytest.raises(asyncio.CancelledError) as cancelled:
        await asyncio.sleep(10.0)
    with pytest.raises(ZeroDivisionError):
        await life.end(cancelled.value)
    assert asyncio.current_task().cancelling() == 0
    await asyncio.sleep(0)


async def test_if_it_fails_at_the_end_of_its_body_that_is_told():
    life = Life(failing(0.0), Stop())
    await asyncio.sleep(0)
    await asyncio.sleep(0)  # it has failed
    with pytest.raises(ZeroDivisionError):
        await life.end(None)
    assert asyncio.current_task().cancelling() == 0
    await asyncio.sleep(0)


async def test_if_it_fails_while_it_stops_its_end_tells_why():
    async def fails_in_the_end(stop: Stop) -> None:
        await stop.wait()
        raise ZeroDivisionError

    stop = Stop()
    life = Life(fails_in_the_end(stop), stop)
    with pytest.raises(ZeroDivisionError):
        await life.end(None)
    assert asyncio.current_task().cancelling() == 0


async def test_cancelled_while_it_stops_it_waits_for_the_ports_and_for_no_client():
    async def takes_long(stop: Stop) -> None:
        await stop.wait()
        await until(lambda: stop.at_once)
        await asyncio.sleep(1.0)

    stop, loop = Stop(), asyncio.get_running_loop()
    life = Life(takes_long(stop), stop)
    ending = asyncio.create_task(life.end(None))
    for _ in range(3):
        await asyncio.sleep(0.1)
        ending.cancel()
    began = loop.time()
    await asyncio.wait((ending,))
    assert ending.cancelled()
    assert loop.time() - began == pytest.approx(0.8, abs=0.05)
