"""A device server whose TCP now and then stalls, and which works off then what it got."""

import asyncio
import random
from collections.abc import Callable, Sequence
from typing import Final

from gateway.ports.port import Port, PortUser
from kit.device import Answer
from kit.memory import MemoryLine

#: For so many seconds at most; some late windows are shorter.
_LONGEST: Final = 1.0
#: What comes when it goes on keeps its order, in seconds.
_STEP: Final = 1e-5


class StallingServer(MemoryLine):
    """The connection to such a server. In half of all cases the network stalls: then the requests have not arrived.

    Answers to an old connection are lost with it. Left out is what nobody can detect: it never stalls while anything is
    on its way through it, such as an answer that would then come after its late window. Devices act as soon as they are
    asked: a write that is done later than its client believes is no wrong answer.
    """

    def __init__(self, name: str, latency: float) -> None:
        super().__init__(name, latency, has_arrived=self._has_all)
        self.stalls = 0
        #: Called when there is a new connection.
        self.on_open: Callable[[], None] = lambda: None
        self.dice = random.Random(0)
        #: So many of the requests find it stalled, if nothing is on its way through it.
        self.share = 0.0
        self._stands_until = self._quiet_at = 0.0
        self._is_cut = False

    async def open_port(self, user: PortUser) -> Port:
        port = await super().open_port(user)
        self.on_open()
        return port

    def asked(self, answers: Sequence[Answer], now: float) -> list[Answer]:
        """A request has been written: when these answers to it come from here."""
        if now > self._quiet_at and self.dice.random() < self.share:
            self.stalls += 1
            self._is_cut = self.dice.random() < 0.5
            self._stands_until = self._quiet_at = now + self.dice.uniform(0.0, _LONGEST)
        come = []
        for delay, data in answers:
            at = now + delay
            if at < self._stands_until + _STEP:
                self._stands_until += _STEP
                at = self._stands_until
            self._quiet_at = max(self._quiet_at, at)
            come.append(Answer(at - now, data))
        return come

    def _has_all(self) -> bool:
        return not self._is_cut or asyncio.get_running_loop().time() >= self._stands_until
