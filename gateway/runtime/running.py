"""A running gateway: opens, watches, replaces and closes its parts."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager, suppress
from typing import Final

from gateway import events
from gateway.errors import ListenError, PortError, WrongQuestion
from gateway.lines.line import Line
from gateway.listeners.serial import SerialListener
from gateway.listeners.sockets import OpenSockets
from gateway.listeners.tls import TlsListener
from gateway.listeners.udp import UdpListener
from gateway.ports.reconnector import Reconnector
from gateway.runtime.announced import AnnouncedDevices
from gateway.runtime.build import Driver, Gateway, Listener, Part
from gateway.runtime.overdue import LeftBehind, place_of
from gateway.runtime.parts import GatewayLine
from gateway.runtime.recent import Recent
from gateway.runtime.self_state import show_itself
from gateway.state.troubles import StateTroubles

#: How long requests in progress and their clients may take when their part stops, in seconds; and how long ports may
#: take to close then. In total the process ends in less than 5 s. Only a disk that hangs adds to it: 1 s for the files
#: of the state folder, or 2 s with persistent images, and 1 s for the history of the web page.
DRAIN_TIME: Final = 3.0
CLOSING_TIME: Final = 1.5
#: How often this is checked, in seconds.
_DRAIN_STEP: Final = 0.02
#: How long a command waits for lines that were not tried yet, in seconds.
LONGEST_START: Final = 10.0
#: The pause before a line's task is restarted after an unexpected error, in seconds.
_RESTART_PAUSE: Final = 1.0


class Running:
    """A running gateway. `sockets` are those that were bound before the process started.

    `left_behind` are late responses that may still arrive on ports of earlier lines, `announced` is what Home Assistant
    knows from an earlier run, `troubles` those with the state folder.
    """

    def __init__(
        self,
        gateway: Gateway,
        emit: events.Emit,
        sockets: OpenSockets | None = None,
        left_behind: LeftBehind | None = None,
        announced: AnnouncedDevices | None = None,
        troubles: StateTroubles | None = None,
    ) -> None:
        gateway.route()
        self.gateway = gateway
        self.emit = emit
        #: The path of the control socket.
        self.control = ""
        #: The address of the web page, or why there is none though the config has one.
        self.page = ""
        self.page_trouble = ""
        #: Set while clients can connect and no stop was ordered.
        self.ready = asyncio.Event()
        #: Whether the config was accepted when it was last read.
        self.reload_succeeded = True
        self.troubles = troubles
        self.recent = Recent(gateway, asyncio.get_running_loop().time())
        if announced is not None:
            gateway.publishing.announced = announced
        #: Held by who looks for devices: two at once would be in each other's way.
        self.examining = asyncio.Lock()
        self._sockets = sockets or OpenSockets()
        self._left_behind = left_behind or LeftBehind()
        self._tasks: dict[Part, asyncio.Task[None]] = {}
        self._lent: set[GatewayLine] = set()
        self._is_ending = False
        #: Listeners that were removed from the config and still have clients.
        self._going: list[Listener] = []
        self.started = asyncio.get_running_loop().time()
        show_itself(self)

    async def bind(self) -> None:
        """Bind the addresses of all listeners.

        Raises:
            ListenError: one of them cannot be used, or an inherited socket belongs to no listener.
        """
        await self._bind(self.gateway, self.gateway.listeners, self._sockets)

    @asynccontextmanager
    async def lines_open(self) -> AsyncIterator[None]:
        """Open the port of every line and keep it open. At the end all are closed."""
        self._start(self.gateway.parts)
        try:
            yield
        finally:
            self._is_ending = True
            await self._end([*self._tasks, *(line for line in self._lent if line in self.gateway.lines)])
            for mirror in self.gateway.mirrors:
                mirror.close()

    async def tried(self) -> None:
        """Wait until every line was tried once; then mirrors begin to poll."""
        for part in self.gateway.parts:
            await part.reconnector.tried.wait()
        for mirror in self.gateway.mirrors:
            mirror.start()

    async def settled(self) -> None:
        """Wait until every line was tried once, but not for ever: at the start, commands are there before them."""
        with suppress(TimeoutError):
            async with asyncio.timeout(LONGEST_START):
                for part in self.gateway.parts:
                    await part.reconnector.tried.wait()

    def start_listening(self) -> None:
        """Accept clients.

        Raises:
            ListenError: another program has taken an address meanwhile.
        """
        for listener in self.gateway.listeners:
            listener.listen()
        for listener in self.gateway.listeners:
            listener.start()

    def stop_listening(self) -> None:
        """Drop all clients."""
        for listener in (*self.gateway.listeners, *self._going):
            listener.close()

    def keeps(self, part: Part) -> bool:
        """Whether the line or upstream is still part of the gateway, and the gateway does not stop."""
        return not self._is_ending and part in self.gateway.parts

    def is_lent(self, line: GatewayLine) -> bool:
        """Whether the port of a line is lent."""
        return line in self._lent

    @asynccontextmanager
    async def port_lent(self, line: GatewayLine, to: str) -> AsyncIterator[list[Line]]:
        """Close the port of `line` for the context, where it may be opened otherwise; requests to the line get 0A.

        `to` says what for. Every Line that uses the port meanwhile belongs in the list that the context is given: who
        has the port afterwards knows which of their responses may still come (docs/adr/0005-late-answers.md).

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
            self._take_back(line, borrowers)
            if task is not None and self.keeps(line):
                line.reconnector.begin_anew()
                self._tasks[line] = asyncio.create_task(_keep(line, self.emit), name=f"line:{line.name}")

    def _take_back(self, line: GatewayLine, borrowers: Iterable[Line]) -> None:
        """Tell the lines on a port that was lent, or the next process, which responses may still come there."""
        now, place = asyncio.get_running_loop().time(), place_of(line.plan.port)
        open_there = [each for borrower in borrowers for each in borrower.ledger.handed_on(now, line.patience)]
        successors = [each for each in self.gateway.lines if place_of(each.plan.port) == place]
        for successor in successors:
            successor.driver.line.ledger.take_over(open_there, successor.patience)
        if open_there and (self._is_ending or not successors):
            self._left_behind.leave(place, [*self._left_behind.at(place, now), *open_there], now)

    async def drain(self, is_urgent: Callable[[], bool]) -> None:
        """Take no more clients and requests, and let those in progress finish, unless that becomes urgent.

        Requests that are not finished after DRAIN_TIME are answered as if their line was lost: 0B if sent, 0A if not.
        """
        listeners = (*self.gateway.listeners, *self._going)
        drivers = [part.driver for part in self._tasks]
        servers = [driver for driver in drivers if isinstance(driver, SerialListener)]
        for end in (*listeners, *servers):
            end.finish()
        fleet = self.gateway.fleet
        await _until(lambda: is_urgent() or not (fleet.is_busy or _any_under_way(listeners, servers)))
        for driver in drivers:
            if not isinstance(driver, SerialListener):
                driver.port_down(PortError("the gateway is stopping"))

    async def switch(self, new: Gateway) -> None:
        """Switch to another gateway. Parts that both have are not interrupted.

        Raises:
            ListenError: as `bind`; nothing has changed.
        """
        old = self.gateway
        gone = [one for one in old.listeners if one not in new.listeners]
        come = [one for one in new.listeners if one not in old.listeners]
        await self._take_sockets(new, come, gone)
        for listener in gone:
            if isinstance(listener, UdpListener):
                listener.close()  # only who hears all that a client sends knows which response it still waits for
            else:
                listener.finish()
        new.route()
        new.publishing.rerouted(new)
        self.gateway = new
        show_itself(self)
        _close_mirrors(old, new)
        for listener in come:
            listener.start()
        self._going += gone
        async with asyncio.TaskGroup() as group:
            for listener in gone:
                group.create_task(self._retire_listener(listener), name=f"retire:{listener.settings.name}")
            retiring = [
                (place_of(part.plan.port), group.create_task(self._retire(part), name=f"retire:{part.name}"))
                for part in old.parts
                if part not in new.parts
            ]
            for part in new.parts:
                if part not in old.parts:
                    before = [task for there, task in retiring if there == place_of(part.plan.port)]
                    group.create_task(self._start_after(before, part), name=f"start:{part.name}")
            for mirror in new.mirrors:
                mirror.start()
            await new.fleet.adopt(new.plan.fleet)
            await new.fleet.refresh()
            await new.publishing.adopt(new)

    def renew_certificates(self) -> None:
        """After a reload: clients that may not be trusted any more must show their certificates again."""
        for listener in self.gateway.listeners:
            if isinstance(listener, TlsListener):
                listener.renew()

    async def _take_sockets(self, new: Gateway, come: list[Listener], gone: list[Listener]) -> None:
        """Listen at the addresses of the new listeners (`come`), replacing old ones (`gone`) where necessary."""
        sockets = OpenSockets(self._sockets.all, leaving=(sock for one in gone for sock in one.sockets))
        try:
            await self._bind(new, come, sockets)
            for listener in come:
                listener.listen()
        except ListenError:
            for listener in come:
                listener.close()
            sockets.put_back()
            raise

    async def _bind(self, gateway: Gateway, come: Iterable[Listener], sockets: OpenSockets) -> None:
        """Bind the addresses of the new listeners (`come`)."""
        for error in await asyncio.gather(*(listener.find() for listener in come), return_exceptions=True):
            if error is not None:
                raise error
        for listener in come:
            listener.bind(sockets)
        self._check_inherited_sockets(gateway)

    def _check_inherited_sockets(self, gateway: Gateway) -> None:
        """Check that each inherited socket belongs to a listener: otherwise its clients would wait for ever."""
        left_over = self._sockets.list_unused(sock for one in gateway.listeners for sock in one.sockets)
        if left_over:
            advice = "add one, or take it out of modbus-gateway.socket, then systemctl restart modbus-gateway.socket"
            raise ListenError(f"systemd has opened {', '.join(left_over)}, which no [[listen]] names; {advice}")

    def _start(self, parts: Iterable[Part]) -> None:
        now = asyncio.get_running_loop().time()
        for part in parts:
            if isinstance(part, GatewayLine):
                part.begin()
                open_there = self._left_behind.at(place_of(part.plan.port), now)
                part.driver.line.ledger.take_over(open_there, part.patience)
            self._tasks[part] = asyncio.create_task(_keep(part, self.emit), name=f"line:{part.name}")

    async def _retire_listener(self, listener: Listener) -> None:
        """Close a listener that takes no more requests, once its clients have their responses."""
        await _until(lambda: not listener.has_clients)
        listener.close()
        self._going.remove(listener)

    async def _retire(self, part: Part) -> None:
        """Stop a part once the requests in progress are finished; waiting ones are refused."""
        part.driver.finish()
        await _until(lambda: not part.driver.is_busy)
        await self._end([part])

    async def _start_after(self, before: list[asyncio.Task[None]], part: Part) -> None:
        """Start a part once the previous parts on its port have stopped."""
        if before:
            await asyncio.wait(before)
        self._start([part])

    async def _end(self, parts: list[Part]) -> None:
        tasks = [self._tasks[part] for part in parts if part in self._tasks]
        for task in tasks:
            task.cancel()
        with suppress(TimeoutError):  # a driver hangs; its port is closed with the process
            async with asyncio.timeout(CLOSING_TIME):
                await asyncio.gather(*tasks, return_exceptions=True)
        now = asyncio.get_running_loop().time()
        for part in parts:
            if isinstance(part, GatewayLine):
                self._left_behind.leave(place_of(part.plan.port), part.handed_on(now), now)
            part.driver.close()
            self._tasks.pop(part, None)


async def _keep(part: Part, emit: events.Emit) -> None:
    reconnector: Reconnector = part.reconnector
    while True:
        try:
            await (part.run() if isinstance(part, GatewayLine) else reconnector.run())
        except Exception as error:  # noqa: BLE001 - the supervisor's error boundary: others go on
            emit(events.PartFailed.of(f"line {part.name}", error))
            reconnector.report_failure(PortError(f"a defect in the gateway: {error!r}"))
        await asyncio.sleep(_RESTART_PAUSE)


def _close_mirrors(old: Gateway, new: Gateway) -> None:
    """Close the mirrors that are gone; those of the same device in `new` learn of writes that are under way."""
    for mirror in old.mirrors:
        if mirror not in new.mirrors:
            mirror.close(each for each in new.mirrors if each.device is mirror.device)


def _any_under_way(listeners: Iterable[Listener], drivers: Iterable[Driver]) -> bool:
    """Whether a client still has to get a response."""
    return any(one.has_clients for one in listeners) or any(one.is_busy for one in drivers)


async def _until(is_done: Callable[[], bool]) -> None:
    """Wait until it is done, but not longer than DRAIN_TIME."""
    loop = asyncio.get_running_loop()
    end = loop.time() + DRAIN_TIME
    while loop.time() < end and not is_done():
        await asyncio.sleep(_DRAIN_STEP)
