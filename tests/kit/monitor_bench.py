"""A monitor of a bus in virtual time: frames and other bytes are put on it, and what was heard is kept.

bench = MonitorBench()
bench.hears(1, "03 00 10 00 02")            # a request, or a response; CRC or LRC are added
bench.passes(0.02)
assert bench.take() == [...]
"""

from collections.abc import Callable

from gateway.events import Event
from gateway.lines.monitor.monitor import HeardTransaction, Monitor
from gateway.lines.settings import LineSettings
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import rtu
from gateway.modbus.pdu import RequestPdu
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.trace.ring import Ring

RTU = LineTiming("rtu", 19200, CharacterFormat.parse("8E1"))
ASCII = LineTiming("ascii", 19200, CharacterFormat.parse("7E1"))
#: The late window of all units but those that a test gives another one, in seconds.
WINDOW = 5.0
#: After so long nothing that was heard before, or missed, is in the way any more, in seconds.
CLEAR = WINDOW + 2.0


class MonitorBench:
    """`ticks` are the times at which the driver reads the port and lets time pass."""

    def __init__(self, timing: LineTiming = RTU, *, is_clear: bool = True) -> None:
        self.now = 100.0
        self.timing = timing
        self.ring = Ring(1 << 20)
        self.events: list[Event] = []
        self.heard: list[HeardTransaction] = []
        self.windows: dict[int, float] = {}
        self.stands_still = False
        self.monitor = Monitor(
            LineSettings("old-plc", timing, turnaround=0.1),
            self._window,
            self.events.append,
            self.ring,
            lambda heard, _: self.heard.append(heard),
            {3: (63, "boiler")},
        )
        self.monitor.port_up(self.now)
        if is_clear:
            self.passes(CLEAR)

    def frame(self, unit: int, pdu: bytes | str) -> bytes:
        """The ADU of a PDU."""
        encode: Callable[[int, bytes], bytes] = ascii_framing.encode if self.timing.mode == "ascii" else rtu.encode
        return encode(unit, bytes.fromhex(pdu) if isinstance(pdu, str) else pdu)

    def hears(self, unit: int, pdu: bytes | str) -> None:
        """A whole frame comes."""
        self.receives(self.frame(unit, pdu))

    def receives(self, data: bytes, *, damaged: bool = False) -> None:
        """These bytes are read, now."""
        self.monitor.received(data, self.now, damaged=damaged)

    def passes(self, seconds: float) -> None:
        """Time passes; the driver reads the port before each tick, and nothing has come."""
        end = self.now + seconds
        while not self.stands_still:
            deadline = self.monitor.deadline()
            if deadline is None or deadline > end:
                break
            self.now = max(self.now, deadline)
            self.monitor.tick(self.now)
        self.now = end

    def take(self) -> list[tuple[int, str, str | None, bool]]:
        """What was heard since the last time: unit, request, response, whether its values are sure."""
        heard, self.heard[:] = list(self.heard), []
        return [
            (each.unit, _hex(each.asked.data), None if each.response is None else _hex(each.response.pdu), each.is_sure)
            for each in heard
        ]

    def _window(self, unit: int, _: RequestPdu) -> float:
        return self.windows.get(unit, WINDOW)


def _hex(pdu: bytes) -> str:
    return pdu.hex(" ").upper()
