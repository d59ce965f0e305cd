"""A gateway that a program starts and stops."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, closing
from functools import partial
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from gateway.clock.threads import ThreadPerCall
from gateway.config.machine.file_text import folder_of
from gateway.control.server import control_open
from gateway.events import Event
from gateway.library.belonging import belonging
from gateway.library.event_stream import EventStreams
from gateway.library.life import Life, unless
from gateway.library.loading import load_libraries
from gateway.library.log import EventLog
from gateway.library.reading_config import GivenConfig, Units, read_file, read_table, read_text
from gateway.library.state import state_open
from gateway.library.unit_client import UnitClient
from gateway.observe.event_file import events_kept
from gateway.observe.fan_out import FanOut
from gateway.operator.operator import Operator
from gateway.ports.opener import make_opener
from gateway.runtime.custom_images import units_made
from gateway.runtime.kept_state import KeptState
from gateway.runtime.reload import Reloader, tell_loaded, warn_of_certificates
from gateway.runtime.running import Running
from gateway.service.supervisor import Stop, serve
from gateway.service.systemd import Notifier
from gateway.state.applied_configs import AppliedConfigs
from gateway.tls.store import TlsStore, load_all

_NOT_RUNNING: Final = "the gateway is not running: use it inside `async with gateway`"


class Gateway:
    """A gateway, which runs while its context is open, in the event loop of the program.

        async with Gateway.from_toml("plant.toml") as gateway:
            print(await gateway.unit("silo-1").read("weight"))

    Several may run at once; each runs once. `units` are made in Python, by the number that clients use.
    """

    def __init__(
        self,
        table: Mapping[str, Any],
        *,
        units: Units | None = None,
        state: str | Path | None = None,
        folder: str | Path = "",
    ) -> None:
        """Read and check a config that is a dict: see `from_dict`."""
        self._take(read_table(table, folder, units or {}, has_state=state is not None), units, state)

    def _take(self, config: GivenConfig, units: Units | None, state: str | Path | None) -> None:
        self._config = config
        self._units = dict(units or {})
        self._state = None if state is None else Path(state).absolute()
        self._log = EventLog()
        self._events = EventStreams(self._log.emit)
        self._life: Life | None = None
        self._operator: Operator | None = None

    @classmethod
    def _of(cls, config: GivenConfig, units: Units | None, state: str | Path | None) -> Self:
        made = cls.__new__(cls)
        made._take(config, units, state)  # noqa: SLF001 - its own
        return made

    @classmethod
    def from_toml(cls, path: str | Path, *, units: Units | None = None, state: str | Path | None = None) -> Self:
        """Read and check the config in a file.

        `units` are those that the program has made, each in place of the `[[image]]` with `python` and its number, or
        one more. What outlives the program is kept in the folder `state`, which no other gateway may use; without it
        nothing is written to a disk.

        Blocks for some 10 ms; a long config takes two seconds for 10 000 points. Where the event loop must go on:
        `await asyncio.to_thread(Gateway.from_toml, path)`.

        Raises:
            ConfigError: it has errors. Its `problems` are those that `modbus-gateway check` tells.
        """
        found = read_file(path, units or {}, has_state=state is not None)
        return cls._of(found, units, state)

    @classmethod
    def from_text(
        cls,
        text: str,
        *,
        units: Units | None = None,
        state: str | Path | None = None,
        folder: str | Path = "",
    ) -> Self:
        """Read and check a config that is a text; otherwise as `from_toml`.

        Relative paths and own profiles are looked for in `folder`, by default the working directory.
        """
        found = read_text(text, folder, units or {}, has_state=state is not None)
        return cls._of(found, units, state)

    @classmethod
    def from_dict(
        cls,
        table: Mapping[str, Any],
        *,
        units: Units | None = None,
        state: str | Path | None = None,
        folder: str | Path = "",
    ) -> Self:
        """Read and check a config that is a dict, as `tomllib` makes it; otherwise as `from_text`.

        It may have tuples and paths too. Problems name a key, such as `line[0].baud`, and neither line nor column. The
        dict is neither changed nor kept. `Gateway(table)` does the same.
        """
        return cls(table, units=units, state=state, folder=folder)

    @property
    def addresses(self) -> list[str]:
        """The addresses where clients can connect, such as `tcp://127.0.0.1:5020`."""
        return [str(listener.address) for listener in self._running.gateway.listeners]

    def unit(self, unit: int | str) -> UnitClient:
        """Return a unit, by the number that clients use or by its name.

        Raises:
            NotConfigured: there is none.
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
            ConfigError: a unit made in Python that the config names cannot be made.
            ListenError: an address cannot be used.
            StateError: another gateway uses the folder `state`, or a later version has written what is in it.
            TlsError: a certificate or a key cannot be used.
            RuntimeError: it was started before, or one of its `units` belongs to another gateway that runs.
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
        with closing(self._log), closing(self._events), belonging(self._units, self.unit):
            fan_out = FanOut(self._events.emit)
            async with state_open(self._state, self._config.plan, fan_out.emit, stop) as kept:
                await self._run_with(kept, fan_out, ready, stop)

    async def _run_with(self, kept: KeptState, fan_out: FanOut, ready: "_Ready", stop: Stop) -> None:
        config, plan, loop = self._config, self._config.plan, asyncio.get_running_loop()
        emit = fan_out.emit if kept.troubles is None else kept.troubles.emit
        contexts = TlsStore()
        tell_loaded(config.place, plan, config.problems, emit)
        if plan.secured:
            reading = loop.run_in_executor(ThreadPerCall("read certificates"), load_all, plan.secured)
            certificates = await unless(stop, reading)
            warn_of_certificates(certificates, emit)
            contexts.adopt(certificates)
        await load_libraries(plan)
        folder = folder_of(config.file)
        making = loop.run_in_executor(ThreadPerCall("make units"), units_made, plan.images, self._units, folder)
        made = await unless(stop, making)
        links = (config.file if plan.control is None else Path(plan.control)).parent
        running = Running(
            plan,
            partial(make_opener, store=contexts, folder=links),
            emit,
            kept,
            contexts=contexts,
            units=self._units,
            folder=folder,
            made=made,
        )
        running.builder.custom.find = self.unit
        operator = Operator(running, self._reloader(running, ready, kept.folder), events=fan_out.last)
        pages = None
        if plan.web is not None:
            opening = import_module("gateway.web.front.opening")
            pages = opening.web_pages(plan.web, operator, fan_out, kept.folder)
        self._operator = operator
        try:
            async with AsyncExitStack() as beside:
                if kept.folder is not None:
                    await beside.enter_async_context(events_kept(fan_out.last, kept.folder, emit))
                if plan.control is not None:
                    await beside.enter_async_context(control_open(Path(plan.control), operator, emit))
                await serve(running, stop, ready, operator.reloader, pages, control=plan.control or "")
        finally:
            self._operator = None

    def _reloader(self, running: Running, manager: Notifier, folder: Path | None) -> Reloader:
        config, applied = self._config, None
        if folder is not None and not config.fixed:
            applied = AppliedConfigs(folder, config.file.name, running.emit)
        return Reloader(
            config.file,
            running,
            manager,
            text=config.text,
            profile_texts=config.profile_texts,
            read=config.read,
            applied=applied,
            fixed=config.fixed,
        )

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
