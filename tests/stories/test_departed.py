"""Nobody is refused for requests that no client waits for any more, whichever way they came."""

import asyncio

import pytest

from gateway.events import QueueFull, WriteAudit
from kit.gateway_bench import Client, GatewayBench, gateway_bench
from kit.over_tcp import OverTcpClient

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:5020"
unit0 = "broadcast"

[[listen]]
bind = "rtu+tcp://127.0.0.1:5021"

[[line]]
port     = "/dev/hall-a"
queue    = 2
max_wait = "1 min"
devices  = [{ unit = "1-3" }, { unit = 4, name = "meter", timeout = "10 s" }]

[[image]]
unit = 200
of   = "meter"
read = [{ holding = "0-9", every = "10 min" }]
"""
READ, OTHER, WRITE = "03 0000 0001", "03 0001 0001", "06 0001 0005"


def is_refused(bench: GatewayBench, others: int = 2) -> bool:
    """Whether somebody is when others ask."""
    for number in range(1, 1 + others):
        bench.client(f"10.0.0.{number}:1").ask(number, READ)
    return any(isinstance(event, QueueFull) for event in bench.events)


async def keep_busy(bench: GatewayBench) -> None:
    """The polls of the mirror have failed until its device rests, and another request is on the line."""
    await asyncio.sleep(300)
    bench.client("10.0.0.9:9").ask(4, "04 0000 0001")


async def fills(bench: GatewayBench, client: Client, *requests: tuple[int, str]) -> None:
    """These wait for the line."""
    await keep_busy(bench)
    for request in requests:
        client.ask(*request)
    assert len(bench.gateway.lines[0].driver.line.queue) == 2


@pytest.mark.parametrize(
    "requests",
    [
        pytest.param([(1, READ), (2, READ)], id="reads"),
        pytest.param([(1, WRITE), (2, WRITE)], id="writes, whose results are logged"),
        pytest.param([(200, WRITE), (1, READ)], id="a write through a mirror"),
        pytest.param([(0, WRITE), (1, READ)], id="a broadcast"),
    ],
)
async def test_a_client_has_closed_its_connection(requests: list[tuple[int, str]]) -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        await fills(bench, client, *requests)
        client.session.closed()
        assert not is_refused(bench)
        told = {event.unit for event in bench.events if isinstance(event, WriteAudit)}
        assert told == {unit for unit, pdu in requests if pdu is WRITE}


async def test_a_client_has_closed_its_side_and_waits_for_reads_only() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        await fills(bench, client, (1, WRITE), (2, READ))
        client.session.end_of_input()
        assert not is_refused(bench, 1)
        assert client.responses.get_nowait()[2] == "86 06"
        assert client.responses.empty()
        assert is_refused(bench, 1)


async def test_a_client_has_used_the_transaction_identifiers_again() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        await fills(bench, client, (1, READ), (2, READ))
        client._transaction = 0
        client.ask(3, READ)
        client.ask(1, OTHER)
        assert not any(isinstance(event, QueueFull) for event in bench.events)


async def test_a_client_of_rtu_over_tcp_has_asked_something_else() -> None:
    async with gateway_bench(CONFIG) as bench:
        await keep_busy(bench)
        bench.client("10.0.0.8:1").ask(1, READ)
        client = OverTcpClient(bench.gateway.listeners[1])
        client.ask(READ, 2)
        assert len(bench.gateway.lines[0].driver.line.queue) == 2
        client.session.closed()
        assert not is_refused(bench, 1)
