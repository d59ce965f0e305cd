"""A gateway that a program starts and stops."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import closing
from functools import partial
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from gateway.clock.threads import ThreadPerCall
from gateway.config.load import load, parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve
from gateway.errors import ConfigError
from gateway.events import Event
from gateway.images.custom_unit import CustomUnit
from gateway.library.event_stream import EventStreams
from gateway.library.life import Life
from gateway.library.log import log_event
from gateway.library.unit_client import UnitClient
from gateway.observe.fan_out import FanOut
from gateway.operator.operator import Operator
from gateway.ports.opener import make_opener
from gateway.runtime.reload import Reloader, warn_of_certificates
from gateway.runtime.running import Running
from gateway.service.supervisor import Stop, serve
from gateway.service.systemd import Notifier
from gateway.tls.store import TlsStore, load_all

_NOT_RUNNING: Final = "the gateway is not running: use it inside `async with gateway`"
#: The units that a program has made, by number.
Units = Mapping[int, CustomUnit]


class Gateway:
    """A gateway, which runs while its context is open, in the event loop of the program.

        async with Gateway.from_toml("plant.toml") as gateway:
            print(await gateway.unit("silo-1").read("weight"))

    Several may run at once; each runs once. `units` are made in Python, by the number that clients use.
    """

    def __init__(self, plan: Plan, text: str, file: Path, units: Units | None = None) -> None:
        """Use `from_toml` or `from_text`."""
        self._plan = plan
        self._text = text
        self._file = file
        self._units = units or {}
        self._events = EventStreams(log_event)
        self._life: Life | None = None
        self._operator: Operator | None = None

    @classmethod
    def from_toml(cls, path: str | Path, *, units: Units | None = None) -> Self:
        """Read and check the config in a file. Blocks for a moment.

        Raises:
            ConfigError: it has problems.
        """
        return cls._of(load(path), Path(path), units)

    @classmethod
    def from_text(cls, text: str, *, units: Units | None = None) -> Self:
        """Read and check a config. Own profiles are looked for as if it were a file in the working directory.

        Raises:
            ConfigError: it has problems.
        """
        return cls._of(parse(text), Path("gateway.toml"), units)

    @classmethod
    def _of(cls, loaded: Any, file: Path, units: Units | None) -> Self:
        if loaded.config is None:
            raise ConfigError("\n".join(loaded.errors), loaded.problems)
        return cls(resolve(loaded.config), loaded.text, file, units)

    @property
    def addresses(self) -> list[str]:
        """The addresses where clients can connect, such as `tcp://127.0.0.1:5020`."""
        return [str(listener.address) for listener in self._running.gateway.listeners]

    def unit(self, unit: int | str) -> UnitClient:
        """Return a unit, by the number that clients use or by its name.

        Raises:
            UnknownUnit: there is none.
        """
        return UnitClient(self._asked, unit)

    def events(self) -> AsyncIterator[Event]:
        """Open a stream of the events from now on, those from INFO on, which ends when the gateway has stopped.

        Before the start it has those of the start too. It is for one reader; any number may be open, and one that is
        not read on need not be closed. Where it was read too slowly, an `EventsDropped` says how many are missing.
        """
        return self._events.open()

    async def __aenter__(self) -> Self:
        """Start: listen, and open the lines. If this is cancelled, all is closed again.

        If the gateway fails later, by a defect, the body of the context is cancelled, and its end raises the error.

        Raises:
            ListenError: an address cannot be used.
            TlsError: a certificate or a key cannot be used.
            RuntimeError: it was started before.
        """
        if self._life is not None:
            raise RuntimeError("a gateway runs once: make another one")
        ready, stop = _Ready(), Stop()
        self._life = Life(self._run(ready, stop), stop)
        try:
            await ready.event.wait()
        except asyncio.CancelledError as error:
            cancelled = error
        else:
            return self
        await self._life.end(cancelled)
        raise cancelled

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Stop: clients get the responses that they wait for, within 3 s; then all ports are closed, within 2 s.

        When this is cancelled, it does not wait for responses, but still for the ports.
        """
        if self._life is None:
            raise RuntimeError(_NOT_RUNNING)
        await self._life.end(error)

    async def _run(self, ready: "_Ready", stop: Stop) -> None:
        """Run until `stop`, as the daemon does."""
        with closing(self._events):
            plan, fan_out, loop = self._plan, FanOut(self._events.emit), asyncio.get_running_loop()
            contexts = TlsStore()
            if plan.secured:
                certificates = await loop.run_in_executor(ThreadPerCall("read certificates"), load_all, plan.secured)
                warn_of_certificates(certificates, fan_out.emit)
                contexts.adopt(certificates)
            running = Running(plan, partial(make_opener, store=contexts), fan_out.emit, contexts=contexts)
            reloader = Reloader(self._file, running, ready, text=self._text)
            operator = Operator(running, reloader, events=fan_out.last)
            pages = None
            if plan.web is not None:  # only then is its library loaded
                opening = await loop.run_in_executor(
                    ThreadPerCall("load web"), import_module, "gateway.web.front.opening"
                )
                pages = opening.web_pages(plan.web, operator, fan_out, None)
            self._operator = operator
            try:
                await serve(running, stop, ready, reloader, pages)
            finally:
                self._operator = None

    @property
    def _running(self) -> Running:
        return self._asked().running

    def _asked(self) -> Operator:
        if self._operator is None:
            raise RuntimeError(_NOT_RUNNING)
        return self._operator


class _Ready(Notifier):
    """Takes the place of systemd: `event` is set once clients can connect."""

    def __init__(self) -> None:
        super().__init__({})
        self.event: Final = asyncio.Event()

    def ready(self, status: str) -> None:
        """Note that clients can connect."""
        super().ready(status)
        self.event.set()
