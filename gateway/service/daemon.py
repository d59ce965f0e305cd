"""The process of a gateway: its log, its state, its signals, and what is open while it runs."""

import asyncio
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, nullcontext, suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from gateway import events
from gateway.clock.exact_loop import run_exactly
from gateway.config.machine.file_text import folder_of
from gateway.config.plan.settings import Plan, WebPlan
from gateway.control.path import control_path, usual_path_leads
from gateway.control.server import control_open
from gateway.errors import ConfigError, ListenError, StateError, TlsError
from gateway.listeners.sockets import OpenSockets
from gateway.observe.event_file import events_kept
from gateway.observe.fan_out import FanOut
from gateway.observe.journal import leads_to_journal
from gateway.observe.log import open_log
from gateway.operator.operator import Operator
from gateway.ports.opener import make_opener
from gateway.readconfig.process import ConfigRead
from gateway.runtime import garbage
from gateway.runtime.kept_state import KeptState, state_kept
from gateway.runtime.reload import Reloader, tell_loaded, warn_of_certificates
from gateway.runtime.remembered import in_force
from gateway.runtime.running import Running
from gateway.service.hang_up import HangUp
from gateway.service.supervisor import Stop, serve
from gateway.service.systemd import Notifier, take_inherited_sockets
from gateway.state.applied_configs import AppliedConfigs
from gateway.state.memory import state_folder
from gateway.state.troubles import StateTroubles
from gateway.tls.store import TlsStore, load_all

#: Makes the client of a unit, by number or name, of the gateway that an operator works on.
UnitClients = Callable[[Callable[[], Operator], int | str], Any]


class _Source(NamedTuple):
    """The config file, by a path that counts wherever code of units goes, and what was read of it."""

    file: Path
    read: ConfigRead


def run_daemon(file: Path, read: ConfigRead, plan: Plan, control: str | None, unit_client: UnitClients) -> None:
    """Run the `plan` that was `read` from `file`, until SIGTERM or SIGINT. `control` overrides the socket's path.

    Units made in Python ask others through what `unit_client` makes.

    Raises:
        ConfigError: a unit made in Python cannot be made.
        ListenError: a listener's address cannot be used.
        StateError: the remembered state cannot be read.
        TlsError: a certificate or a key cannot be used.
    """
    try:
        with open_log(plan.log.level, plan.log.format) as log:
            fan_out = FanOut(log)
            tell_loaded(str(file), plan, read.problems, fan_out.emit)
            path = Path(control or plan.control or control_path(file)).absolute()
            _serve(plan, _Source(file.absolute(), read), path, fan_out, unit_client)
    except (ConfigError, ListenError, StateError, TlsError) as error:
        tell_journal(events.ConfigRejected.of(str(file), [str(error)]))
        raise


def tell_journal(rejected: events.ConfigRejected) -> None:
    """Log it to the journal too, if stderr goes there: what the command prints has no priority and no fields."""
    if leads_to_journal(2):
        with open_log("error", "journald") as emit:
            emit(rejected)


def _serve(plan: Plan, source: _Source, control: Path, fan_out: FanOut, unit_client: UnitClients) -> None:
    folder = state_folder()
    troubles = StateTroubles(folder, fan_out.emit)
    with state_kept(folder, troubles) as kept:
        for remembered in in_force(plan, kept.memory):
            troubles.emit(remembered)
        run_exactly(_run(plan, source, control, kept, folder, fan_out, troubles.emit, unit_client))


def _load_certificates(plan: Plan, emit: events.Emit) -> TlsStore:
    contexts, certificates = TlsStore(), load_all(plan.secured)
    warn_of_certificates(certificates, emit)
    contexts.adopt(certificates)
    return contexts


async def _run(
    plan: Plan,
    source: _Source,
    control: Path,
    kept: KeptState,
    folder: Path,
    fan_out: FanOut,
    emit: events.Emit,
    unit_client: UnitClients,
) -> None:
    loop = asyncio.get_running_loop()
    if plan.web is not None:
        with suppress(ImportError, OSError):  # told when the pages are opened
            import_module("gateway.web.front.server")
    garbage.pass_over_present()
    contexts = _load_certificates(plan, emit)
    open_port = partial(make_opener, store=contexts, folder=control.parent)

    systemd, stop, hang_up = Notifier(), Stop(), HangUp()
    sockets = OpenSockets(take_inherited_sockets())
    running = Running(plan, open_port, emit, kept, contexts=contexts, sockets=sockets, folder=folder_of(source.file))
    applied, read = AppliedConfigs(folder, source.file.name, emit), source.read
    reloader = Reloader(
        source.file,
        running,
        systemd,
        text=read.text,
        profile_texts=read.profile_texts,
        applied=applied,
        settle=garbage.settle,
    )
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.order, number.name)
    loop.add_signal_handler(signal.SIGHUP, _reload_or_stop, reloader, stop, hang_up)
    operator = Operator(running, reloader, events=fan_out.last)
    running.builder.custom.find = partial(unit_client, lambda: operator)
    pages = _web_pages(plan.web, operator, fan_out, folder)
    with usual_path_leads(control_path(source.file), control):
        async with events_kept(fan_out.last, folder, emit), control_open(control, operator, emit):
            await serve(running, stop, systemd, reloader, pages, control=str(control))


@asynccontextmanager
async def _web_pages(plan: WebPlan | None, *parts: Any) -> AsyncIterator[None]:
    """Open the web pages inside the context. Without [web], nothing of them is imported."""
    pages = nullcontext() if plan is None else import_module("gateway.web.front.opening").web_pages(plan, *parts)
    async with pages:
        garbage.settle()
        yield


def _reload_or_stop(reloader: Reloader, stop: Stop, hang_up: HangUp) -> None:
    """Handle SIGHUP: stop if the terminal was closed, else reload the config."""
    if hang_up.is_end:
        stop.order("SIGHUP")
    else:
        reloader.order()
