"""A gateway that a program starts and stops."""

import asyncio
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from gateway.config.load import load, parse
from gateway.config.plan.settings import Plan
from gateway.config.resolve import resolve
from gateway.errors import ConfigError, UnknownUnit, WrongQuestion
from gateway.images.custom_unit import CustomUnit
from gateway.library.log import log_event
from gateway.library.unit_client import UnitClient
from gateway.observe.fan_out import FanOut
from gateway.operator.operator import Operator
from gateway.operator.units import picture
from gateway.ports.opener import make_opener
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.service.supervisor import Stop, serve
from gateway.service.systemd import Notifier
from gateway.tls.store import TlsStore

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
        self._stop: Stop | None = None
        self._task: asyncio.Task[None] | None = None
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
        operator = self._asked()
        try:
            found = picture(operator.gateway, unit)
        except WrongQuestion as wrong:
            raise UnknownUnit(str(wrong)) from None
        return UnitClient(operator, found.key, found.name)

    async def __aenter__(self) -> Self:
        """Start: listen, and open the lines.

        Raises:
            ListenError: an address cannot be used.
        """
        fan_out, contexts = FanOut(log_event), TlsStore()
        running = Running(self._plan, partial(make_opener, store=contexts), fan_out.emit, contexts=contexts)
        self._operator = Operator(running, Reloader(self._file, running, Notifier({}), text=self._text))
        self._stop = Stop()
        self._task = asyncio.create_task(serve(running, self._stop), name="gateway")
        ready = asyncio.create_task(running.ready.wait(), name="gateway ready")
        try:
            await asyncio.wait((self._task, ready), return_when=asyncio.FIRST_COMPLETED)
        finally:
            ready.cancel()
        if self._task.done():
            self._task.result()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Stop: requests in progress are finished, for a second at most; all ports are closed."""
        if self._stop is not None and self._task is not None:
            self._stop.order("closed")
            await self._task

    @property
    def _running(self) -> Running:
        return self._asked().running

    def _asked(self) -> Operator:
        if self._operator is None:
            raise RuntimeError("the gateway has not been started: async with gateway")
        return self._operator
