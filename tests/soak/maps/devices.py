"""Devices with values of every type, which say whose they are and when the device told them.

Each read is remembered with its time: what a client sees must be what was told then. Holding registers and coils are
written with numbers that are given out once, see `dated`.
"""

import struct
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator
from math import floor
from typing import Final

from gateway.modbus.codes import Area
from gateway.modbus.pdu import RequestPdu
from kit.faulty import FaultyDevice
from soak.dated import DatedDevice, Write, Writes
from soak.maps.conversion import Encoding

#: The items of each area that maps read.
ITEMS: Final = {Area.INPUT: 27, Area.HOLDING: 16, Area.COILS: 16, Area.DISCRETE: 32}
_READS: Final = {1: Area.COILS, 2: Area.DISCRETE, 3: Area.HOLDING, 4: Area.INPUT}
_TICKS: Final = 10_000
_ROUND: Final = 1 << 22
#: For so many seconds it is remembered what was told, and how often what is older is forgotten.
_MEMORY: Final = 90.0
_FORGETS: Final = 500
_COIL_WRITES: Final = 1024
_WRITE, _MASK_WRITE = 6, 22
#: An int16 that means that there is no value.
NO_VALUE: Final = -0x8000


class Point:
    """A point of these devices: its name, its place and how it is encoded there; where it is written, if it is."""

    def __init__(self, name: str, area: Area, first: int, encoding: Encoding | None, *, written_at: int = -1) -> None:
        self.name = name
        self.area = area
        self.first = first
        self.encoding = encoding
        self.written_at = written_at
        self.count = 1 if encoding is None else encoding.count

    @property
    def config(self) -> str:
        """Its row of the profile."""
        keys = [f'name = "{self.name}"', f"{self.area} = {self.first}"]
        how = self.encoding
        if how is not None:
            keys += [f'swap = "{how.swap}"'] if how.swap != "none" else []
            keys += [f"scale = {how.scale}"] if how.scale != "1" else []
            keys += [f"offset = {how.offset}"] if how.offset != "0" else []
            keys.append('type = "string"' if how.type == "string" else f'type = "{how.type}"')
            keys += [f"length = {how.text}"] if how.type == "string" else []
            keys += [f"invalid = {list(how.invalid)}"] if how.invalid else []
            keys += [f'bits = "{how.bits[0]}-{how.bits[1]}"'] if how.bits and how.bits != (0, 0) else []
            keys += ["bit = 0"] if how.bits == (0, 0) else []
        if self.written_at >= 0:
            keys.append("write = true")
            keys += [f"write_at = {self.written_at}"] if self.written_at != self.first else []
        return "{ " + ", ".join(keys) + " }"


def _inputs() -> Iterator[Point]:
    encodings = {
        "pair-0": (0, Encoding("uint32")),
        "pair-1": (2, Encoding("uint32", "words")),
        "pair-2": (4, Encoding("int32", "bytes", "0.1")),
        "pair-3": (6, Encoding("uint32", "both", "0.5", "-7")),
        "single": (8, Encoding("float32")),
        "double": (10, Encoding("float64", scale="0.25")),
        "digits": (14, Encoding("bcd32")),
        "signal": (16, Encoding("int16", scale="0.1", offset="-40", invalid=(NO_VALUE,))),
        "level": (17, Encoding("uint16")),
        "state": (18, Encoding("uint16", bits=(4, 11))),
        "flag": (18, Encoding("uint16", bits=(0, 0))),
        "long": (19, Encoding("uint64", "words")),
        "text": (23, Encoding("string", text=4)),
    }
    for name, (first, encoding) in encodings.items():
        yield Point(name, Area.INPUT, first, encoding)


POINTS: Final = {
    point.name: point
    for point in (
        *_inputs(),
        Point("set-long", Area.HOLDING, 8, Encoding("uint32"), written_at=8),
        Point("set-point", Area.HOLDING, 10, Encoding("uint16", scale="0.1"), written_at=10),
        Point("set-turned", Area.HOLDING, 11, Encoding("int32", "words", "0.5", "100"), written_at=11),
        Point("set-elsewhere", Area.HOLDING, 14, Encoding("int16"), written_at=15),
        Point("on", Area.COILS, 3, None),
        Point("alarm", Area.DISCRETE, 5, None),
    )
}
PROFILE: Final = (
    "[profile.meter]\nmax_gap = 4\npoints = [\n" + "".join(f"    {each.config},\n" for each in POINTS.values()) + "]\n"
)


class Told:
    """What a device told of one area, and when; and what rows make of it, which is found out once."""

    __slots__ = ("at", "items", "shown")

    def __init__(self, at: float, items: tuple[int, ...]) -> None:
        self.at = at
        self.items = items
        self.shown: dict[object, tuple[int, ...] | None] = {}


class MapDevice(DatedDevice):
    """A device that remembers what it told. `written_at` is when each item was written last through a polled unit."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]
        self.told: dict[Area, list[Told]] = {area: [] for area in ITEMS}
        self.written_at: dict[Area, list[float]] = {area: [-1.0] * count for area, count in ITEMS.items()}
        #: Writes of coils that were asked for; they do not have values of their own, as registers do.
        self.coil_writes: deque[Write] = deque(maxlen=_COIL_WRITES)

    def respond(self, pdu: bytes) -> bytes:
        """Act on a request; the right answer."""
        now = self._clock()
        self._set_values(floor(now * _TICKS) % _ROUND)
        if pdu[0] == _MASK_WRITE:  # with an AND mask of 0, it is a write
            super().respond(bytes((_WRITE,)) + pdu[1:3] + pdu[5:])
            return pdu
        response = super().respond(pdu)
        area = _READS.get(pdu[0])
        if area is not None and response[0] == pdu[0]:
            told = self.told[area]
            told.append(Told(now, tuple(map(int, getattr(self, area)[: ITEMS[area]]))))
            if len(told) > 2 * _FORGETS and told[_FORGETS].at < now - _MEMORY:
                del told[:_FORGETS]
        return response

    def between(self, area: Area, since: float, until: float) -> Iterator[Told]:
        """What it told in this time, the newest first."""
        told = self.told[area]
        for at in range(bisect_left(told, since, key=lambda each: each.at), len(told))[::-1]:
            if told[at].at <= until:
                yield told[at]

    def acknowledged(self, area: Area, write: Write) -> None:
        """A write through a map or a mirror is acknowledged."""
        for address in write.addresses:
            self.written_at[area][address] = max(self.written_at[area][address], write.done_at or -1.0)

    def _set_values(self, ticks: int) -> None:
        """Set the values of other types than those of a dated device."""
        single = struct.pack(">f", float(self.number << 18 | ticks >> 4))
        double = struct.pack(">d", float(self.number << 26 | 5 << 22 | ticks))
        digits = bytes.fromhex(f"{self.number % 100:02d}{ticks // 10 % 1_000_000:06d}")
        signal = NO_VALUE if ticks // 4000 % 8 == 0 else ticks // 20 % 20_000 - 10_000
        level = self.number << 10 | ticks // 100 % 1024
        state = self.number << 4 | ticks >> 10 & 0xF
        long = (self.number << 55 | 7 << 51 | ticks << 20 | ticks).to_bytes(8, "big")
        text = f"{chr(ord('A') + self.number % 26)}{ticks:07d}".encode()
        data = single + double + digits + struct.pack(">hHH", signal, level, state) + long + text
        self.input[8:27] = [int.from_bytes(data[at : at + 2], "big") for at in range(0, len(data), 2)]
        whole = self.number << 26 | 9 << 22 | ticks
        self.discrete[:32] = [bool(whole >> bit & 1) for bit in range(32)]

    def _write(self, asked: RequestPdu, values: list[int]) -> None:
        if asked.write is None or asked.write.area is Area.HOLDING:
            super()._write(asked, values)
            return
        FaultyDevice._write(self, asked, values)
        self._write_coils(asked.write.start, [int(value) for value in values])

    def _write_coils(self, first: int, values: list[int]) -> None:
        fitting = [each for each in self.coil_writes if (each.first, each.values) == (first, values)]
        for write in fitting:
            if not write.is_refused and not write.is_acknowledged:
                write.done_at = self._clock()
        if not fitting:
            self._writes.complain(f"coils {values} of device {self.number} were written from {first} on: unasked")


class MapImage(MapDevice):
    """A local image as a source: what it holds is looked up whenever somebody wants to know. `look` reads it."""

    def __init__(self, number: int, writes: Writes, clock: Callable[[], float], look: Callable[[], list[int]]) -> None:
        super().__init__(0, number=number, writes=writes, clock=clock)
        self._look = look
        self._last: list[int] = [0] * ITEMS[Area.HOLDING]
        self._changed_at = [clock()] * ITEMS[Area.HOLDING]
        self.told[Area.HOLDING].append(Told(clock(), tuple(self._last)))

    def between(self, area: Area, since: float, until: float) -> Iterator[Told]:
        """What it held in this time, the newest first."""
        self.look()
        for told in reversed(self.told[area]):
            if told.at <= until:
                yield told
            if told.at <= since:
                break

    def acknowledged(self, area: Area, write: Write) -> None:
        """A write is acknowledged: now it must be there, or what another client has written at the same moment."""
        self.look()
        now, there = self._clock(), zip(write.addresses, write.values, strict=True)
        if all(self._last[at] == value or self._changed_at[at] == now for at, value in there):
            write.done_at = write.done_at or now
        super().acknowledged(area, write)

    def look(self) -> None:
        """Note what has changed, by writes that were asked for."""
        now, holds = self._clock(), self._look()
        if holds == self._last:
            return
        for address, (before, after) in enumerate(zip(self._last, holds, strict=True)):
            write = self._writes.of(after)
            if before == after:
                continue
            self._changed_at[address] = now
            if (
                write is None
                or write.device is not self
                or after != dict(zip(write.addresses, write.values, strict=True)).get(address)
            ):
                self._writes.complain(f"the image has {after} at {address}, which nobody asked for")
            else:
                write.done_at = write.done_at or now
        self._last = holds
        told = self.told[Area.HOLDING]
        told.append(Told(now, tuple(holds)))
        if len(told) > 2 * _FORGETS and told[_FORGETS].at < now - _MEMORY:
            del told[:_FORGETS]
