"""`run`: the gateway in the foreground."""

import argparse
import asyncio
import signal
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

from gateway import events
from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.config.load import load
from gateway.config.plan import Plan, resolve
from gateway.images.store import Store
from gateway.observe.log import open_log
from gateway.ports.kinds import opener
from gateway.service.build import build
from gateway.service.remembered import in_force
from gateway.service.state import Memory, StateFile, state_folder
from gateway.service.supervisor import Stop, serve


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `run`."""
    parser.add_argument("config", nargs="?", default=DEFAULT_CONFIG, help=f"the config file (default {DEFAULT_CONFIG})")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT.

    Raises:
        ListenError: a listener's address cannot be used.
        StateError: what was remembered cannot be read.
    """
    file = Path(args.config)
    loaded = load(file)
    if loaded.config is None:
        print(*loaded.problems, sep="\n", file=sys.stderr)
        return PROBLEM_FOUND
    plan = resolve(loaded.config)
    with open_log(plan.log.level, plan.log.format) as emit:
        emit(events.ConfigLoaded(str(file), len(plan.lines) + len(plan.servers), _units(plan)))
        for problem in loaded.problems:
            emit(events.ConfigWarning(str(replace(problem, remedy="")), problem.remedy))
        with closing(StateFile(state_folder(), emit)) as memory, _open_store(plan, emit) as store:
            for remembered in in_force(plan, memory):
                emit(remembered)
            asyncio.run(_run(plan, file, memory, store, emit))
    return FINE


@contextmanager
def _open_store(plan: Plan, emit: events.Emit) -> Iterator[Store | None]:
    """Where images are kept, if one is."""
    if all(image.persist == "never" for image in plan.images):
        yield None
        return
    with closing(Store(state_folder(), emit)) as store:
        yield store


async def _run(plan: Plan, file: Path, memory: Memory, store: Store | None, emit: events.Emit) -> None:
    loop = asyncio.get_running_loop()
    gateway = build(plan, loop, opener, memory, emit, store)
    stop = Stop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.order, number.name)
    loop.add_signal_handler(signal.SIGHUP, _hang_up, file, stop, emit)
    await serve(gateway, stop, emit)


def _hang_up(file: Path, stop: Stop, emit: events.Emit) -> None:
    """SIGHUP: a terminal that was closed ends what runs in it; a daemon is asked to read its config again."""
    if sys.stderr.isatty():
        stop.order("SIGHUP")
    else:
        emit(events.ConfigRejected(str(file), "reload is not built yet in this version; restart to apply changes"))


def _units(plan: Plan) -> int:
    behind = (*(line.devices for line in plan.lines), *(upstream.devices for upstream in plan.upstreams))
    return sum(map(len, behind)) + len(plan.images)
