"""The ports of a running gateway: a task keeps each open, a reload replaces some, and one may be lent meanwhile."""

import asyncio
from collections.abc import AsyncIterator, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from typing import Final

from gateway import events
from gateway.errors import PortError, WrongQuestion
from gateway.lines.line import Line
from gateway.ports.reconnector import Reconnector
from gateway.runtime.draining import until
from gateway.runtime.gateway import Driver, Part
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.overdue import LeftBehind, place_of

#: How long ports may take to close when their part stops, in seconds.
CLOSING_TIME: Final = 1.5
#: The pause before a line's task is restarted after an unexpected error, in seconds.
_RESTART_PAUSE: Final = 1.0


class OpenPorts:
    """Keeps the ports and connections of parts open.

    `left_behind` are late responses that may still arrive on ports of earlier lines.
    """

    def __init__(self, emit: events.Emit, left_behind: LeftBehind) -> None:
        #: The parts of the gateway in use.
        self.present: tuple[Part, ...] = ()
        self._emit = emit
        self._left_behind = left_behind
        self._tasks: dict[Part, asyncio.Task[None]] = {}
        self._lent: set[GatewayLine] = set()
        self._is_ending = False

    @property
    def drivers(self) -> Sequence[Driver]:
        """The drivers of all parts whose ports are kept open, those of an earlier gateway included."""
        return [part.driver for part in self._tasks]

    def keeps(self, part: Part) -> bool:
        """Return whether the line or upstream is still part of the gateway, and the gateway does not stop."""
        return not self._is_ending and part in self.present

    def is_lent(self, line: GatewayLine) -> bool:
        """Return whether the port of a line is lent."""
        return line in self._lent

    @asynccontextmanager
    async def lent(self, line: GatewayLine, to: str) -> AsyncIterator[list[Line]]:
        """Close the port of `line` inside the context, where it may be opened otherwise; requests to the line get 0A.

        `to` says what for. Add every Line that uses the port to the list that is yielded: the next line there then
        knows which of their responses may still come (docs/adr/0005-late-answers.md).

        Raises:
            WrongQuestion: it is lent already, or has a lease.
        """
        if line.standby is not None:
            raise WrongQuestion(
                f"the port of {line.name} cannot be lent: others may ask there (lease {line.standby.name})"
            )
        if line in self._lent:
            raise WrongQuestion(f"the port of {line.name} is lent already: {line.reconnector.error}")
        self._lent.add(line)
        borrowers: list[Line] = []
        task = self._tasks.pop(line, None)
        try:
            if task is not None:
                task.cancel()
                await asyncio.wait((task,), timeout=CLOSING_TIME)
            line.reconnector.report_failure(PortError(f"its port is lent to {to}"))
            yield borrowers
        finally:
            self._lent.remove(line)
            self.take_back(line, borrowers)
            if task is not None and self.keeps(line):
                line.reconnector.begin_anew()
                self._tasks[line] = asyncio.create_task(_keep(line, self._emit), name=f"line:{line.name}")

    def take_back(self, line: GatewayLine, borrowers: Iterable[Line]) -> None:
        """Pass on which responses may still come to the port of `line`, to its lines or to the next process.

        It was lent to the `borrowers`, or no line of the gateway had it.
        """
        now, place = asyncio.get_running_loop().time(), place_of(line.plan.port)
        open_there = [each for borrower in borrowers for each in borrower.ledger.handed_on(now, line.patience)]
        lines = [part for part in self.present if isinstance(part, GatewayLine)]
        successors = [each for each in lines if place_of(each.plan.port) == place]
        for successor in successors:
            successor.take_over(open_there)
        if open_there and (self._is_ending or not successors):
            self._left_behind.leave(place, [*self._left_behind.at(place, now), *open_there], now)

    def start(self, parts: Iterable[Part]) -> None:
        """Open the ports of `parts`, and keep them open."""
        now = asyncio.get_running_loop().time()
        for part in parts:
            if isinstance(part, GatewayLine):
                part.begin()
                part.take_over(self._left_behind.at(place_of(part.plan.port), now))
            self._tasks[part] = asyncio.create_task(_keep(part, self._emit), name=f"line:{part.name}")

    def replace(self, old: Sequence[Part], new: Sequence[Part], group: asyncio.TaskGroup) -> None:
        """Stop the `old` parts that are not among the `new` ones, and start the others, each once its port is free."""
        retiring = [
            (place_of(part.plan.port), group.create_task(self._retire(part), name=f"retire:{part.name}"))
            for part in old
            if part not in new
        ]
        for part in new:
            if part not in old:
                before = [task for there, task in retiring if there == place_of(part.plan.port)]
                group.create_task(self._start_after(before, part), name=f"start:{part.name}")

    async def end(self, parts: Sequence[Part]) -> None:
        """Close the ports of `parts`, and keep what may still arrive there."""
        tasks = [self._tasks[part] for part in parts if part in self._tasks]
        for task in tasks:
            task.cancel()
        try:
            with suppress(TimeoutError):  # a driver hangs; its port is closed when it returns
                async with asyncio.timeout(CLOSING_TIME):
                    await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            now = asyncio.get_running_loop().time()
            for part in parts:
                if isinstance(part, GatewayLine):
                    self._left_behind.leave(place_of(part.plan.port), part.handed_on(now), now)
                part.driver.close()
                self._tasks.pop(part, None)

    async def end_all(self) -> None:
        """Close all ports, for good."""
        self._is_ending = True
        await self.end([*self._tasks, *(line for line in self._lent if line in self.present)])

    async def _retire(self, part: Part) -> None:
        """Stop a part once the requests in progress are finished; waiting ones are refused."""
        part.driver.finish()
        await until(lambda: not part.driver.is_busy)
        await self.end([part])

    async def _start_after(self, before: list[asyncio.Task[None]], part: Part) -> None:
        """Start a part once the previous parts on its port have stopped."""
        if before:
            await asyncio.wait(before)
        self.start([part])


async def _keep(part: Part, emit: events.Emit) -> None:
    reconnector: Reconnector = part.reconnector
    while True:
        try:
            await (part.run() if isinstance(part, GatewayLine) else reconnector.run())
        except Exception as error:  # noqa: BLE001 - the supervisor's error boundary: others go on
            emit(events.PartFailed.of(f"line {part.name}", error))
            reconnector.report_failure(PortError(f"a defect in the gateway: {error!r}"))
        await asyncio.sleep(_RESTART_PAUSE)
