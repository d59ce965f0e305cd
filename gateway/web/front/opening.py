"""`[web]`: metrics and health over HTTP. Its libraries are loaded only if configured."""

import asyncio
import ssl
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractContextManager, AsyncExitStack, aclosing, asynccontextmanager
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from gateway import events
from gateway.clock.threads import ThreadPerCall
from gateway.config.plan.rights_in_words import RightsRow
from gateway.config.plan.settings import WebPlan
from gateway.errors import TlsError, UsersError
from gateway.listeners.kept_sessions import KeptSessions
from gateway.modbus.pdu import Span, exception_response
from gateway.observe.fan_out import FanOut, Follower
from gateway.operator import answer_times, failures, kept, reached
from gateway.operator import status as told
from gateway.operator.answer_times import FunctionTimes
from gateway.operator.answers.status import (
    ImageStatus,
    LineStatus,
    MirrorStatus,
    ServerStatus,
    Status,
    UnitStatus,
    UpstreamStatus,
)
from gateway.operator.answers.trace import Fact
from gateway.operator.answers.unit import UnitPicture
from gateway.operator.config_view import ConfigView, ConfigViewer
from gateway.operator.failures import Failure
from gateway.operator.history import history_kept
from gateway.operator.kept import ImageWindow, Kept
from gateway.operator.operations import Traced
from gateway.operator.requests import AwaitedOrigin, send
from gateway.operator.rights import Verdict, rights_in_words, routers, verdict
from gateway.operator.trace_reader import Texts, TraceReader, capture, latest, may_see_all
from gateway.operator.units import picture, pictures
from gateway.readconfig.libraries import not_installed
from gateway.readconfig.password import read_token
from gateway.runtime.gateway import Gateway
from gateway.runtime.outcome import Outcome
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.timing.history import History, Past
from gateway.tls.contexts import Loaded
from gateway.tls.store import TlsStore, load_all
from gateway.tools.examinations import Examinations
from gateway.web.api.answers import Answer, WebClient

#: How old the status may be that is told, in seconds: any number of readers costs no more than one.
_STATUS_KEPT: Final = 1.0


@asynccontextmanager
async def web_pages(
    plan: WebPlan | None,
    running: Running,
    reloader: Reloader,
    fan_out: FanOut,
    folder: Path | None = None,
) -> AsyncIterator[None]:
    """In its context the gateway answers over HTTP if the config says so. Where that cannot be, it is told, no more.

    The history is kept in the `folder`.
    """
    async with AsyncExitStack() as stack:
        if plan is not None:
            try:
                await stack.enter_async_context(_open(plan, running, reloader, fan_out, folder))
            except ModuleNotFoundError as error:
                _tell_closed(plan, running, not_installed(error.name, "web"))
            except OSError as error:
                _tell_closed(plan, running, f"{error.filename or ''} {error.strerror or error}".strip())
            except (UsersError, TlsError) as error:
                _tell_closed(plan, running, str(error))
        yield


def _tell_closed(plan: WebPlan, running: Running, reason: str) -> None:
    running.page_trouble = f"{plan.bind} cannot be used: {reason}"
    running.emit(events.WebClosed(str(plan.bind), reason))


@asynccontextmanager
async def _open(
    plan: WebPlan, running: Running, reloader: Reloader, fan_out: FanOut, folder: Path | None
) -> AsyncIterator[None]:
    server = import_module("gateway.web.front.server")
    settings = server.WebSettings(
        host=plan.bind.host,
        port=plan.bind.port,
        hosts=plan.hosts,
        token="" if plan.token is None else read_token(plan.token),
        users=_users(plan),
        tls=_context_now(plan, running.contexts),
        proxy=plan.proxy,
        write=plan.write,
    )
    taken = [sock for listener in running.gateway.listeners for sock in listener.sockets]
    async with (
        history_kept(running, folder if plan.history else None) as history,
        aclosing(_Answers(running, reloader, fan_out, history)) as answers,
        server.web_open(settings, answers, taken) as address,
    ):
        running.page = address
        running.emit(events.WebUp(address))
        yield


def _context_now(plan: WebPlan, contexts: TlsStore) -> Callable[[], ssl.SSLContext] | None:
    """Gives each connection what was loaded last, by a reload or to forget sessions; None for http://.

    Raises:
        TlsError: a file cannot be used.
    """
    tls = plan.tls
    if tls is None:
        return None
    contexts.add(load_all(plan.secured))
    latest = contexts[tls]

    def in_use() -> Loaded:
        nonlocal latest
        latest = contexts.get(tls, latest)  # files that a reload has renamed are used after a restart
        return latest

    def replace(before: Loaded, fresh: Loaded) -> None:
        nonlocal latest
        latest = fresh if latest is before else latest
        contexts.renew(tls, before, fresh)

    kept = KeptSessions(tls, in_use, replace)

    def context() -> ssl.SSLContext:
        kept.limit()
        return in_use().context

    return context


def _users(plan: WebPlan) -> Path | None:
    return None if plan.users is None else Path(plan.users)


class _Answers:
    """See gateway.web.api.answers."""

    types: Final[Mapping[str, type]] = {
        "Status": Status,
        "Line": LineStatus,
        "Server": ServerStatus,
        "Upstream": UpstreamStatus,
        "UnitStatus": UnitStatus,
        "Image": ImageStatus,
        "Mirror": MirrorStatus,
        "Unit": UnitPicture,
        "Reload": Outcome,
    }

    def __init__(
        self,
        running: Running,
        reloader: Reloader,
        fan_out: FanOut,
        history: History,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._running = running
        self._reloader = reloader
        self._fan_out = fan_out
        self._history = history
        self._clock = clock
        self._read = import_module("gateway.operator.metrics").read
        metrics = import_module("gateway.observe.metrics")
        self._exposition = metrics.exposition
        self.content_type: str = metrics.CONTENT_TYPE
        self._status: Status | None = None
        self._one_status_at_a_time = asyncio.Lock()
        #: The gateway whose units were described last: a reload makes another one.
        self._pictured: Gateway | None = None
        self._pictures: Sequence[UnitPicture] = ()
        self._texts = Texts()
        self.doctor = Examinations(running, clock)
        self._config = ConfigViewer(running, reloader, clock)

    async def aclose(self) -> None:
        """End what is in progress for the pages."""
        await self.doctor.close()

    async def metrics(self) -> bytes:
        """Read the counters in slices and format them in a thread, so that lines do not wait for that."""
        loop = asyncio.get_running_loop()
        families = await self._read(self._running)
        text: bytes = await loop.run_in_executor(ThreadPerCall("metrics"), self._exposition, families)
        return text

    def failed(self, error: Exception) -> None:
        self._running.emit(events.PartFailed.of("web", error))

    def logged_in(self, client: str, user: str) -> None:
        self._running.emit(events.WebLogin(client, user))

    def login_failed(self, client: str, user: str) -> None:
        self._running.emit(events.WebLoginFailed(client, user))

    def users_rejected(self, reason: str) -> None:
        self._running.emit(events.WebUsersRejected(reason))

    @property
    def site(self) -> str:
        return self._running.gateway.plan.site

    def trouble(self) -> str:
        """Why the gateway is not ready: it is while clients can connect and a line is up or an image exists."""
        if not self._running.ready.is_set():
            return "clients cannot connect"
        gateway = self._running.gateway
        reconnectors = [
            *(line.reconnector for line in gateway.lines),
            *(upstream.reconnector for upstream in gateway.upstreams),
        ]
        return (
            ""
            if gateway.images or any(reconnector.is_open for reconnector in reconnectors)
            else "no line is up, and there is no image"
        )

    async def status(self) -> Status:
        """That of now, or of less than a second ago."""
        async with self._one_status_at_a_time:
            now = asyncio.get_running_loop().time()
            if self._status is None or now - self._status.at >= _STATUS_KEPT:
                self._status = await told.status_in_slices(self._running)
            return self._status

    def past(self, slots: int) -> Past:
        return self._history.last(self._clock(), slots)

    def units(self) -> Sequence[UnitPicture]:
        if self._pictured is not self._running.gateway:
            self._pictured = self._running.gateway
            self._pictures = pictures(self._pictured)
        return self._pictures

    def unit(self, wanted: int | str) -> UnitPicture:
        return picture(self._running.gateway, wanted)

    async def ask(self, unit: int, pdu: bytes, client: WebClient) -> Answer:
        """By the way of `[[access]] listen = ["web"]`."""
        question = AwaitedOrigin(client.is_there, client.caller)
        done = await send(self._running.routers.web, unit, pdu, question)
        response = exception_response(pdu[0], 0) if done.pdu is None else done.pdu
        if done.error is None:
            return Answer(response, done.elapsed_ms)
        return Answer(response, done.elapsed_ms, done.error.result, str(done.error))

    async def reload(self) -> Mapping[str, Any]:
        return asdict(await asyncio.shield(self._reloader.order()))

    async def config(self) -> ConfigView:
        return await self._config.view()

    def trace(self, asked: Traced, host: str, per_second: int | None = None) -> TraceReader:
        return TraceReader(self._running, asked, host, self._texts, per_second)

    async def latest(self, asked: Traced, host: str, most: int) -> Sequence[Fact]:
        return await latest(self._running, asked, host, most)

    def capture(self, asked: Traced, host: str) -> AsyncIterator[bytes]:
        return capture(self._running, asked, host)

    def rights(self) -> Sequence[RightsRow]:
        return rights_in_words(self._running.gateway)

    def entrances(self) -> Sequence[str]:
        return tuple(routers(self._running))

    def verdict(self, host: str, listener: str, unit: int, function: int, role: str) -> Verdict:
        return verdict(self._running, host, listener, unit, function, role)

    def events(self, host: str) -> AbstractContextManager[Follower]:
        return self._fan_out.following(lambda: may_see_all(self._running, host))

    def may(self, unit: int, function: int, host: str) -> bool:
        return reached.may(self._running, unit, function, host)

    def target(self, unit: int) -> object:
        return reached.target(self._running.gateway, unit)

    def answer_times(self, unit: int) -> Sequence[FunctionTimes]:
        return answer_times.answer_times(self._running.gateway, unit)

    def failures(self, unit: int, host: str) -> Sequence[Failure]:
        return failures.failures(self._running, unit, host)

    def kept(self, unit: int, spans: Sequence[Span]) -> Sequence[Kept | None]:
        return kept.kept(self._running.gateway, unit, spans, asyncio.get_running_loop().time())

    def mirrors_of(self, unit: int) -> Sequence[str]:
        return kept.mirrors_of(self._running.gateway, unit)

    def image(self, unit: int, span: Span) -> ImageWindow | None:
        return kept.window(self._running.gateway, unit, span, asyncio.get_running_loop().time())
