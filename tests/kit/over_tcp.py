"""A client of RTU or ASCII over TCP without a socket."""

import asyncio

from gateway.clock.lazy_timer import LazyTimer
from gateway.listeners.sessions.arrivals import LOOK_STEP
from gateway.listeners.sessions.over_tcp import OverTcpSession
from gateway.listeners.sessions.session import Connection
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.request import Caller
from gateway.runtime.gateway import Listener

ENCODE = {"rtu+tcp": rtu.encode, "ascii+tcp": ascii_framing.encode}


class OverTcpClient(Connection):
    """A client as programs for serial ports are: whatever comes after its request is the response to it."""

    def __init__(self, listener: Listener, name: str = "10.0.0.9:49152") -> None:
        self._loop = asyncio.get_running_loop()
        self._encode = ENCODE[listener.settings.scheme]
        self.session = OverTcpSession(
            Caller(name, "127.0.0.1", "127.0.0.1"),
            router=listener.router,
            connection=self,
            settings=listener.settings,
            now=self._loop.time(),
        )
        self._timer = LazyTimer(self._loop, self._proceed)
        self._looking = LazyTimer(self._loop, self._look)
        self._look()
        self._heard = bytearray()

    def ask(self, pdu: str, unit: int = 1) -> None:
        adu = self._encode(unit, bytes.fromhex(pdu))
        self._heard.clear()
        self.session.room()[: len(adu)] = adu
        self.session.received(len(adu), self._loop.time())

    async def asks(self, pdu: str, time_out: float, unit: int = 1) -> bytes:
        """The response's ADU, or nothing after the time-out."""
        self.ask(pdu, unit)
        await asyncio.sleep(time_out)
        return bytes(self._heard)

    def pdu_of(self, adu: bytes, unit: int) -> bytes:
        """The PDU of a response from `unit`; anything else as it came."""
        if not adu:
            return b""
        pdu = bytes.fromhex(adu[3:-4].decode()) if adu.startswith(b":") else adu[1:-2]
        return pdu if self._encode(unit, pdu) == adu else adu

    def time(self) -> float:
        return self._loop.time()

    def receive(self, room: memoryview) -> int:
        return 0

    def send(self, data: bytes) -> None:
        self._heard += data

    def pause(self) -> None:
        pass

    def resume(self) -> None:
        self.wake(0.0)

    def wake(self, when: float | None) -> None:
        self._timer.set(when)

    def release_after(self, seconds: float) -> None:
        self._loop.call_later(seconds, self.session.release)

    def close(self) -> None:
        self.session.closed()

    def reject(self, reason: str) -> None:
        raise AssertionError(reason)

    def _look(self) -> None:
        self.session.look(self._loop.time())
        self._looking.set(self._loop.time() + LOOK_STEP)

    def _proceed(self) -> None:
        self.session.proceed(self._loop.time())
