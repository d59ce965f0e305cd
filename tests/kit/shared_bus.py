"""One RS-485 bus with several adapters, devices, and a monitor that sees every frame and who has sent it.

Everything takes its time on the wire. Whoever is on the bus hears all others. What two send at once reaches nobody.
"""

import os
import random
import select
import socket
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol, Self

from gateway.modbus.rtu import crc_fits, with_crc
from kit.pty import VirtualPort

#: A register of a unit holds 256 x unit + register, so that each answer tells what it is the answer to.
REGISTERS = 256
UNITS = (1, 2, 3)
#: What a device adds to the wire's time until it answers, in seconds.
THINKS = 0.002
DEVICE = "device"
#: A device whose answer the machine has held up for so long does not answer, in seconds: it may miss its window.
HELD_UP = 0.05
#: Frames of two askers are never nearer than this, in seconds: who takes over opens a port first.
NEAR = 0.002


class Adapter(Protocol):
    """What a gateway is connected to the bus with."""

    def fileno(self) -> int: ...
    def read(self) -> bytes: ...
    def write(self, data: bytes) -> None: ...


class Terminal:
    """A serial adapter: a pseudo-terminal."""

    def __init__(self, path: Path) -> None:
        self.port = VirtualPort(path)

    def fileno(self) -> int:
        return self.port.far_end

    def read(self) -> bytes:
        return os.read(self.port.far_end, 4096)

    def write(self, data: bytes) -> None:
        with suppress(BlockingIOError):  # nobody reads there
            os.write(self.port.far_end, data)

    def close(self) -> None:
        self.port.unplug()


class Connection:
    """A connection to the bus's device server."""

    def __init__(self, accepted: socket.socket) -> None:
        accepted.setblocking(False)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = accepted
        self.is_open = True

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> bytes:
        try:
            data = self._socket.recv(4096)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        self.is_open = bool(data)
        return data

    def write(self, data: bytes) -> None:
        with suppress(OSError):
            self._socket.send(data)

    def close(self) -> None:
        self._socket.close()


@dataclass
class Sent:
    """A frame on the wire, or a piece of one; whose, and from when until when."""

    by: str
    begins: float
    ends: float
    data: bytes
    #: Whose request it answers.
    to: str = ""

    @property
    def asker(self) -> str:
        return self.to or self.by


@dataclass
class Collision:
    """Two askers were on the wire at once: who came second, and when."""

    at: float
    first: str
    second: str


@dataclass
class Bus:
    """`lateness` says by how many seconds a device is late, by chance.

    The wire is busy from the beginning of a request until its answer has ended.
    """

    character: float = 11 / 115200
    lateness: Callable[[], float] = lambda: 0.0
    collisions: list[Collision] = field(default_factory=list)
    frames: int = 0
    #: Answers that were not given: see HELD_UP. Who asked last, and since when.
    held_up: int = 0
    asker: str = ""
    changed_at: float = 0.0
    #: What was heard last, and when.
    heard: deque[tuple[float, Sent]] = field(default_factory=lambda: deque(maxlen=40))
    #: When somebody asked last, by name.
    asked: dict[str, float] = field(default_factory=dict)
    _adapters: dict[str, list[Adapter]] = field(default_factory=dict)
    _listeners: dict[socket.socket, str] = field(default_factory=dict)
    _wire: list[Sent] = field(default_factory=list)
    _due: list[Sent] = field(default_factory=list)
    _pieces: dict[str, Sent] = field(default_factory=dict)

    def terminal(self, name: str, path: Path) -> None:
        """Add a serial adapter."""
        self._adapters[name] = [Terminal(path)]

    def server(self, name: str) -> int:
        """Add a port of a device server; its number."""
        listener = socket.create_server(("127.0.0.1", 0))
        listener.setblocking(False)
        self._listeners[listener] = name
        self._adapters[name] = []
        return int(listener.getsockname()[1])

    def __enter__(self) -> Self:
        self._ours, self._theirs = socket.socketpair()
        self._thread = threading.Thread(target=self._run, name="bus")
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        self._thread.join()
        self._theirs.close()
        for each in self._listeners:
            each.close()
        for adapters in self._adapters.values():
            for adapter in adapters:
                adapter.close()

    def _run(self) -> None:
        while True:
            every = {each: name for name, adapters in self._adapters.items() for each in adapters}
            ends = min((each.ends for each in (*self._due, *self._pieces.values())), default=None)
            wait = 0.5 if ends is None else max(0.0, min(0.5, ends - time.monotonic()))
            ready = select.select([*every, *self._listeners, self._theirs], [], [], wait)[0]
            now = time.monotonic()
            for each in ready:
                if each is self._theirs:
                    return
                if each in self._listeners:
                    self._adapters[self._listeners[each]].append(Connection(each.accept()[0]))
                else:
                    self._take(every[each], each, now)
            self._pass(time.monotonic())

    def _take(self, name: str, adapter: Adapter, now: float) -> None:
        """An adapter begins to send what was written to it, behind what it still sends."""
        data = adapter.read()
        if isinstance(adapter, Connection) and not adapter.is_open:
            adapter.close()
            self._adapters[name].remove(adapter)
        if not data:
            return
        piece = self._pieces.get(name)
        if piece is None:
            self._pieces[name] = Sent(name, now, now + self.character * len(data), data)
            self._look(self._pieces[name])
        else:
            piece.data += data
            piece.ends += self.character * len(data)

    def _look(self, sent: Sent) -> None:
        """Whether somebody else is on the wire."""
        self.frames += 1
        if sent.asker != self.asker:
            self.asker, self.changed_at = sent.asker, sent.begins
        self.asked[sent.asker] = sent.begins
        others = [each for each in (*self._wire, *self._due, *self._pieces.values()) if each.asker != sent.asker]
        met = [each for each in others if each.begins < sent.ends + NEAR and sent.begins < each.ends + NEAR]
        if met:
            self.collisions.append(Collision(sent.begins, met[0].asker, sent.asker))

    def _pass(self, now: float) -> None:
        """What has ended on the wire is heard by all others. A device answers a request."""
        self._wire = [each for each in self._wire if each.ends > now - 1.0]
        for name, piece in [(name, piece) for name, piece in self._pieces.items() if piece.ends <= now]:
            del self._pieces[name]
            self._hear(piece)
            self._answer(piece)
        for each in [each for each in self._due if each.ends <= now]:
            self._due.remove(each)
            if now < each.ends + HELD_UP:
                self._hear(each)
            else:
                self.held_up += 1

    def _hear(self, sent: Sent) -> None:
        self._wire.append(sent)
        self.heard.append((time.monotonic(), sent))
        for name, adapters in self._adapters.items():
            for adapter in adapters if name != sent.by else ():
                adapter.write(sent.data)

    def _answer(self, asked: Sent) -> None:
        frame = asked.data
        if len(frame) != 8 or not crc_fits(frame) or frame[0] not in UNITS or frame[1] != 3:
            return
        register, count = int.from_bytes(frame[2:4]), int.from_bytes(frame[4:6])
        values = b"".join((256 * frame[0] + register + at).to_bytes(2) for at in range(count))
        data = with_crc(bytes((frame[0], 3, 2 * count)) + values)
        begins = asked.ends + THINKS + self.lateness()
        answer = Sent(DEVICE, begins, begins + self.character * len(data), data, to=asked.by)
        self._look(answer)
        self._due.append(answer)


def sometimes_late(seed: int, share: float, longest: float) -> Callable[[], float]:
    """Devices that are late in this share of answers, by up to so many seconds."""
    choose = random.Random(seed)
    return lambda: choose.uniform(0.0, longest) if choose.random() < share else 0.0
