"""`[web]`: pages and an API over HTTP, opened if they are configured: only then are their libraries loaded."""

import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from importlib import import_module
from pathlib import Path

from gateway import events
from gateway.config.plan.settings import WebPlan
from gateway.errors import TlsError, UsersError
from gateway.listeners.kept_sessions import KeptSessions
from gateway.observe.fan_out import FanOut
from gateway.operator.operator import Operator
from gateway.operator.past.history import history_kept
from gateway.operator.trends.kept import trends_kept
from gateway.readconfig.libraries import not_installed
from gateway.readconfig.password import read_token
from gateway.runtime.running import Running
from gateway.tls.contexts import Loaded
from gateway.tls.store import TlsStore, load_all


@asynccontextmanager
async def web_pages(
    plan: WebPlan | None, operator: Operator, fan_out: FanOut, folder: Path | None = None
) -> AsyncIterator[None]:
    """Serve HTTP inside the context, if the config says so. If that fails, it is reported, and nothing else stops.

    The history and trends are kept in the `folder`.
    """
    async with AsyncExitStack() as stack:
        if plan is not None:
            try:
                await stack.enter_async_context(_open(plan, operator, fan_out, folder))
            except ModuleNotFoundError as error:
                _tell_closed(plan, operator.running, not_installed(error.name, "web"))
            except OSError as error:
                _tell_closed(plan, operator.running, f"{error.filename or ''} {error.strerror or error}".strip())
            except (UsersError, TlsError) as error:
                _tell_closed(plan, operator.running, str(error))
        yield


def _tell_closed(plan: WebPlan, running: Running, reason: str) -> None:
    running.page_trouble = f"{plan.bind} cannot be used: {reason}"
    running.emit(events.WebClosed(str(plan.bind), reason))


@asynccontextmanager
async def _open(plan: WebPlan, operator: Operator, fan_out: FanOut, folder: Path | None) -> AsyncIterator[None]:
    server, running = import_module("gateway.web.front.server"), operator.running
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
    kept_in = folder if plan.history else None
    async with (
        history_kept(running, kept_in) as operator.history,
        trends_kept(operator, plan.values, kept_in),
        server.web_open(settings, operator, fan_out, taken) as address,
    ):
        running.page = address
        running.emit(events.WebUp(address))
        yield


def _context_now(plan: WebPlan, contexts: TlsStore) -> Callable[[], ssl.SSLContext] | None:
    """Make the function that returns the TLS context in use, the last one loaded or renewed; None for http://.

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
