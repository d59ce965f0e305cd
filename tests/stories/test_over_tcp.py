"""Clients of RTU and ASCII over TCP, whose time-outs are shorter than the gateway's: none is lied to."""

import asyncio
from random import Random

import pytest

from gateway.listeners.over_tcp import OverTcpSession
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.ports.clock import Alarm
from kit.device import SimulatedDevice, SimulatedLine
from kit.house import House, house

CONFIG = """
[[listen]]
bind = "{scheme}://127.0.0.1:5021"

[[line]]
port    = "/dev/hall-a"
baud    = 19200
timeout = "2 s"
devices = [{{ unit = 1 }}]
"""
ENCODE = {"rtu+tcp": rtu.encode, "ascii+tcp": ascii_framing.encode}


class Client:
    """A client as programs for serial ports are: whatever comes after its request is the response to it."""

    def __init__(self, home: House, scheme: str) -> None:
        self._loop = asyncio.get_running_loop()
        self._encode = ENCODE[scheme]
        listener = home.gateway.listeners[0]
        self.session = OverTcpSession(
            "10.0.0.9:49152",
            host="127.0.0.1",
            router=listener.router,
            connection=self,
            settings=listener.settings,
            now=self._loop.time(),
        )
        self._alarm = Alarm(self._loop, self._proceed)
        self._heard = bytearray()

    def ask(self, pdu: str) -> None:
        adu = self._encode(1, bytes.fromhex(pdu))
        self._heard.clear()
        self.session.room()[: len(adu)] = adu
        self.session.received(len(adu), self._loop.time())

    async def asks(self, pdu: str, time_out: float) -> bytes:
        """The response, or nothing after the time-out."""
        self.ask(pdu)
        await asyncio.sleep(time_out)
        return bytes(self._heard)

    def send(self, data: bytes) -> None:
        self._heard += data

    def pause(self) -> None:
        pass

    def resume(self) -> None:
        self.wake(0.0)

    def wake(self, when: float | None) -> None:
        self._alarm.set(when)

    def close(self) -> None:
        self.session.closed()

    def reject(self, reason: str) -> None:
        raise AssertionError(reason)

    def _proceed(self) -> None:
        self.session.proceed(self._loop.time())


@pytest.mark.parametrize("scheme", ENCODE)
async def test_no_client_takes_a_late_response_for_that_to_its_next_request(scheme: str) -> None:
    random = Random(5)
    async with house(CONFIG.format(scheme=scheme)) as home:
        device = SimulatedDevice(1)
        device.holding = [0x1000 + address for address in range(200)]
        home.attach("hall-a", SimulatedLine("rtu", device))
        client = Client(home, scheme)
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
    async with house(CONFIG.format(scheme="rtu+tcp")) as home:
        device = SimulatedDevice(1, delay=1.5)
        home.attach("hall-a", SimulatedLine("rtu", device))
        other, client = Client(home, "rtu+tcp"), Client(home, "rtu+tcp")
        other.ask("03 0000 0001")
        assert await client.asks("06 0005 0001", time_out=0.5) == b""
        device.delay = 0.01
        assert await client.asks("03 0005 0001", time_out=5.0) == rtu.encode(1, bytes.fromhex("03 02 0000"))
        assert [frame.pdu[0] for frame in device.heard] == [3, 3]
