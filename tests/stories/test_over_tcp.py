"""Clients of RTU and ASCII over TCP, whose time-outs are shorter than the gateway's: none is lied to."""

from random import Random

import pytest

from gateway.modbus import rtu
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench
from kit.over_tcp import ENCODE, OverTcpClient

CONFIG = """
[[listen]]
bind = "{scheme}://127.0.0.1:5021"

[[line]]
port    = "/dev/hall-a"
baud    = 19200
timeout = "2 s"
devices = [{{ unit = 1 }}]
"""


@pytest.mark.parametrize("scheme", ENCODE)
async def test_no_client_takes_a_late_response_for_that_to_its_next_request(scheme: str) -> None:
    random = Random(5)
    async with gateway_bench(CONFIG.format(scheme=scheme)) as bench:
        device = SimulatedDevice(1)
        device.holding = [0x1000 + address for address in range(200)]
        bench.attach("hall-a", SimulatedLine("rtu", device))
        client = OverTcpClient(bench.gateway.listeners[0])
        answered = 0
        for _ in range(2000):
            device.delay = random.choice([0.01, 0.01, 0.2, 0.5, 1.0, 3.0])
            address = random.randrange(200)
            heard = await client.asks(f"03 {address:04X} 0001", time_out=random.choice([0.1, 0.3, 0.6, 1.1]))
            value = bytes.fromhex("03 02") + (0x1000 + address).to_bytes(2)
            failed = b"\x83\x0b"
            assert heard in (b"", ENCODE[scheme](1, value), ENCODE[scheme](1, failed))
            answered += heard == ENCODE[scheme](1, value)
        assert answered > 200


async def test_a_write_that_the_client_has_given_up_is_not_sent_any_more() -> None:
    async with gateway_bench(CONFIG.format(scheme="rtu+tcp")) as bench:
        device = SimulatedDevice(1, delay=1.5)
        bench.attach("hall-a", SimulatedLine("rtu", device))
        other, client = OverTcpClient(bench.gateway.listeners[0]), OverTcpClient(bench.gateway.listeners[0])
        other.ask("03 0000 0001")
        assert await client.asks("06 0005 0001", time_out=0.5) == b""
        device.delay = 0.01
        assert await client.asks("03 0005 0001", time_out=5.0) == rtu.encode(1, bytes.fromhex("03 02 0000"))
        assert [frame.pdu[0] for frame in device.heard] == [3, 3]
