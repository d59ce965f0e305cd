"""Reload: reads the config again, compares it with the one in use, and applies the differences."""

import asyncio
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

from gateway import events
from gateway.clock.beside import end
from gateway.clock.threads import in_thread
from gateway.config.plan.differences import differences, need_restart
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem
from gateway.config.reading.whole_text import parted
from gateway.errors import ConfigError, ListenError, StateError, TlsError
from gateway.readconfig.process import READING_TIME, ReadConfig, read_config
from gateway.runtime.custom_units import outdated
from gateway.runtime.gateway import Gateway
from gateway.runtime.outcome import Outcome
from gateway.runtime.running import Running
from gateway.runtime.summary import summary
from gateway.state.applied_configs import AppliedConfigs
from gateway.tls.contexts import Loaded as LoadedTls
from gateway.tls.settings import Secured
from gateway.tls.store import find_warnings, load_all

#: How long reading what images keep, or certificates, may take, in seconds.
LOADING_TIME: Final = 10.0


@dataclass(frozen=True, slots=True)
class Reloaded:
    """The last reload: `at` this time of the loop's clock, in seconds."""

    at: float
    outcome: Outcome


class ServiceManager(Protocol):
    """The service manager that started the process, and is notified of reloads: systemd, or none."""

    @property
    def is_service(self) -> bool:
        """Whether systemd has started it."""

    def reloading(self) -> None:
        """Notify it that a reload has begun; `ready` follows."""

    def ready(self, status: str) -> None:
        """Notify it that the reload is over, with the `status` in one line."""


class Reloader:
    """Applies `file` to a `running` gateway, one reload at a time.

    `text` is the content of the file, with those that it includes (reading.whole_text), when it was last used, at
    `applied_at` by the loop's clock, and `profile_texts` are the texts of the own profiles that it uses; all are kept
    in `applied`. `read` reads it, in a thread. What images keep is read in a thread too, and so are certificates, even
    those of unchanged tables. `settle` is called after each. `fixed` says why the config cannot be read again, if it
    comes from a program and not from `file`.
    """

    def __init__(
        self,
        file: Path,
        running: Running,
        manager: ServiceManager,
        *,
        text: str = "",
        profile_texts: Mapping[str, str] | None = None,
        read: ReadConfig = read_config,
        applied: AppliedConfigs | None = None,
        settle: Callable[[], None] = lambda: None,
        fixed: str = "",
    ) -> None:
        self.file = file
        self.fixed = fixed
        self.read = read
        self.text = text
        self.profile_texts = profile_texts or {}
        self.applied = applied
        self.applied_at = running.started
        self.last: Reloaded | None = None
        self._running = running
        self._manager = manager
        self._settle = settle
        self.at_start = running.gateway.plan
        self._turn = asyncio.Lock()
        self._next: asyncio.Task[Outcome] | None = None
        self._tasks: set[asyncio.Task[Outcome]] = set()

    @property
    def is_service(self) -> bool:
        """Whether systemd has started the gateway."""
        return self._manager.is_service

    @property
    def place(self) -> str:
        """Where the config is, for display: the path of its file, or what a program calls it."""
        return self.file.name if self.fixed else str(self.file.absolute())

    def order(self) -> asyncio.Task[Outcome]:
        """Order a reload, and return its task. Orders before a reload has begun are combined into one."""
        if self._next is None:
            self._next = asyncio.create_task(self._run(), name="reload")
            self._tasks.add(self._next)
            self._next.add_done_callback(self._tasks.discard)
        return self._next

    async def keep_in_use(self) -> None:
        """Keep the config in use among the last ones; wait for the disk for LOADING_TIME at most."""
        if self.applied is not None:
            with suppress(TimeoutError):
                async with asyncio.timeout(LOADING_TIME):
                    own, included = parted(self.text)
                    await in_thread("keep config", self.applied.keep, own, self.profile_texts, included)

    async def close(self) -> None:
        """Cancel the reloads that are in progress or ordered."""
        await end(*self._tasks)

    async def _run(self) -> Outcome:
        async with self._turn:
            await self._running.ready.wait()
            self._next = None
            self._manager.reloading()
            try:
                return self._told(await self._reload())
            except Exception as error:  # noqa: BLE001 - the supervisor's error boundary: the gateway keeps running
                self._running.reload_succeeded = False
                self._running.emit(events.PartFailed.of("reload", error))
                return self._told(Outcome((f"a defect in the gateway: {error!r}",)))
            finally:
                if self._running.ready.is_set():
                    self._manager.ready(summary(self._running.gateway))

    def _told(self, outcome: Outcome) -> Outcome:
        self.last = Reloaded(asyncio.get_running_loop().time(), outcome)
        return outcome

    async def _reload(self) -> Outcome:
        try:
            async with asyncio.timeout(READING_TIME):
                loaded = await in_thread("read config", self.read, self.file)
        except TimeoutError:
            return self._rejected((f"{self.file}: cannot be read within {READING_TIME:g} s; is its disk there?",))
        except ConfigError as error:
            return self._rejected((str(error),))
        if loaded.plan is None:
            return self._rejected(loaded.errors)
        old, new = self._running.gateway.plan, loaded.plan
        try:
            async with asyncio.timeout(LOADING_TIME):
                certificates, unusable = await in_thread("read certificates", _load, new)
                await in_thread("read state", self._running.builder.prepare, new, old)
                old_code = await in_thread("look at modules", list, outdated(new.images))
            defect = await self._switch(self._running.builder.build(new, self._running.gateway), certificates)
        except TimeoutError:
            what = "what images keep, certificates, or units made in Python,"
            return self._rejected((f"{what} cannot be loaded within {LOADING_TIME:g} s",))
        except (ConfigError, ListenError, StateError, TlsError) as error:
            return self._rejected((str(error),))
        self.text, self.profile_texts = loaded.text, loaded.profile_texts
        self.applied_at = asyncio.get_running_loop().time()
        self._running.reload_succeeded = not defect
        warnings = (*map(str, loaded.problems), *unusable)
        outcome = changed(old, new, self.at_start)
        outcome = replace(outcome, restart=(*outcome.restart, *old_code), warnings=warnings, defect=defect)
        warn(loaded.problems, self._running.emit)
        warn_of_certificates(certificates, self._running.emit)
        for said in unusable:
            self._running.emit(events.ConfigWarning(said, ""))
        self._running.emit(
            events.ConfigApplied(str(self.file), outcome.added, outcome.removed, outcome.changed, outcome.restart)
        )
        await self.keep_in_use()
        self._settle()  # in another turn of the loop than the switch
        return outcome

    async def _switch(self, new: Gateway, certificates: Mapping[Secured, LoadedTls]) -> str:
        """Switch to `new`; return a defect, if one occurred and `new` is in use nevertheless.

        Raises:
            ListenError: as Running.switch.
        """
        contexts = self._running.contexts
        before = contexts.add(certificates)  # parts that are replaced keep their own until then
        try:
            await self._running.switch(new)
        except Exception as error:
            if self._running.gateway is not new:
                contexts.adopt(before)
                self._running.builder.custom.keep(self._running.gateway.images)  # others were built in vain
                raise
            self._running.emit(events.PartFailed.of("reload", error))
            return f"a defect in the gateway: {error!r}; restart it, and please report this"
        finally:
            if self._running.gateway is new:
                contexts.adopt(certificates)
                self._running.renew_certificates()
        return ""

    def _rejected(self, problems: tuple[str, ...]) -> Outcome:
        self._running.reload_succeeded = False
        self._running.emit(events.ConfigRejected.of(str(self.file), problems))
        return Outcome(problems)


def _load(plan: Plan) -> tuple[dict[Secured, LoadedTls], list[str]]:
    """Load the certificates of a plan, and list which of those of add-ons cannot be used: a start goes on without them.

    Raises:
        TlsError: a certificate for clients or lines cannot be used.
    """
    found, unusable = load_all(plan.secured), []
    for secured in (part.secured for part in plan.add_ons.values()):
        try:
            found |= load_all(secured)
        except TlsError as error:
            unusable.append(str(error))
    return found, unusable


def tell_loaded(file: str, plan: Plan, problems: Iterable[Problem], emit: events.Emit) -> None:
    """Log what the gateway starts with, and the warnings about it."""
    units = sum(len(owner.devices) for owner in plan.owners) + len(plan.images)
    emit(events.ConfigLoaded(file, len(plan.lines) + len(plan.servers) + len(plan.monitors), units))
    warn(problems, emit)


def warn(problems: Iterable[Problem], emit: events.Emit) -> None:
    """Log the warnings about a config that is used."""
    for problem in problems:
        emit(events.ConfigWarning(str(replace(problem, remedy="")), problem.remedy))


def warn_of_certificates(loaded: Mapping[Secured, LoadedTls], emit: events.Emit) -> None:
    """Log the warnings about peers that cannot connect with these certificates."""
    for said in find_warnings(loaded):
        emit(events.ConfigWarning(said, ""))


def changed(old: Plan, new: Plan, at_start: Plan) -> Outcome:
    """Tell what a reload of `new` changes where `old` is in use, and what applies only after a restart."""
    found = differences(old, new)
    return Outcome(added=found.added, removed=found.removed, changed=found.changed, restart=need_restart(at_start, new))
