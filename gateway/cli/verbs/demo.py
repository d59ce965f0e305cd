"""`demo`: a gateway with simulated lines; the requests of each device manual are sent once through Modbus TCP."""

import argparse
import asyncio
import os
import signal
import socket
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Iterable, Sequence
from contextlib import AsyncExitStack, ExitStack, asynccontextmanager
from pathlib import Path
from typing import Final

from gateway import events
from gateway.cli.demo.live import (
    LIVE_LINES,
    LIVE_MAPPED,
    Login,
    invitation,
    make_certificates,
    make_login,
    page_config,
    tls_config,
)
from gateway.cli.demo.live import PORT as TLS_PORT
from gateway.cli.demo.past import made_up_day, made_up_events
from gateway.cli.demo.past_values import make_up_values
from gateway.cli.demo.script import (
    CHAPTERS,
    FIRST_QUESTION,
    IMAGE,
    LINES,
    PANEL,
    PANEL_LINE,
    SITE,
    DemoLine,
    virtual_unit,
)
from gateway.cli.demo.stage import Stage
from gateway.cli.demo.traffic import traffic
from gateway.cli.kit.daemon import usual_socket
from gateway.cli.kit.progress import working
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.clock.exact_loop import run_exactly
from gateway.config.load import load
from gateway.config.plan.settings import Plan
from gateway.control.server import control_open
from gateway.errors import GatewayError
from gateway.observe.fan_out import FanOut
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.values.requests import AT_CONTROL
from gateway.ports.opener import make_opener
from gateway.readconfig.libraries import missing_library
from gateway.readconfig.reader import read_here
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.service.supervisor import Stop, serve
from gateway.service.systemd import Notifier
from gateway.simulator.panel import Panel
from gateway.tls.store import TlsStore, load_all
from gateway.web.front.opening import web_pages

#: The ports of the demo and of its page; any free port if one is in use.
_PORT: Final = 5020
_PAGE_PORT: Final = 8502
#: How long each simulator and the gateway may take to start, in seconds: small computers take long for five processes.
_STARTING_DEADLINE: Final = 60.0
#: How long clients poll until all values are known that they ask for, in seconds.
_UNTIL_KNOWN: Final = 3.0


class DemoError(GatewayError):
    """The demo cannot start."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `demo`."""
    parser.add_argument(
        "--once", action="store_true", help="exit after the script, with status 0 if every response was correct"
    )
    parser.add_argument("--tls", action="store_true", help="also a listener with TLS, and certificates to try it")


def run(args: argparse.Namespace) -> int:
    """Run the demo; 1 if a response was wrong."""
    return run_exactly(_until_signal(once=args.once, tls=args.tls))


async def _until_signal(*, once: bool, tls: bool) -> int:
    demo = asyncio.create_task(_demo(once=once, tls=tls), name="demo")
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, demo.cancel)
    try:
        return await demo
    except asyncio.CancelledError:
        print("\nThe demo has ended.")
        return FINE


async def _demo(*, once: bool, tls: bool) -> int:
    print("modbus-gateway demo: a gateway with simulated serial lines\n", flush=True)
    async with AsyncExitStack() as parts:
        starting = parts.enter_context(ExitStack())
        starting.enter_context(working("starting"))
        folder = Path(parts.enter_context(tempfile.TemporaryDirectory(prefix="modbus-gateway-demo.")))
        lines = LINES if once else (*LINES, *LIVE_LINES)
        await parts.enter_async_context(_simulators(lines, folder))
        panel = await parts.enter_async_context(Panel(folder / PANEL, mode="ascii"))
        certificates = make_certificates(folder) if tls else None
        login = make_login(folder) if not once and missing_library("web") is None else None
        config = _write_config(folder, lines, certificates, login)
        plan, text = _plan(config)
        stage = Stage(config, plan)
        running, answers = await parts.enter_async_context(_gateway(config, text, plan, stage))
        if answers.history is not None:  # which is in memory only, as events are: there is no state folder
            now = time.time()
            answers.history.load(made_up_day(plan, now))
            answers.events.load(made_up_events(plan, now))
        await parts.enter_async_context(stage.connected(running.gateway))
        starting.close()
        wrong = await _play(stage, panel)
        if not once:
            control = _control(folder)
            await parts.enter_async_context(control_open(control, answers, stage.tell))
            await parts.enter_async_context(traffic(stage.address, panel))
            stage.invite(control, login)
            if certificates is not None:
                print(invitation(certificates, running.gateway.listeners[1].address), flush=True)
            await asyncio.sleep(_UNTIL_KNOWN)
            await make_up_values(answers, Asker(AT_CONTROL, lambda: True))
            await asyncio.Event().wait()
    return PROBLEM_FOUND if wrong else FINE


async def _play(stage: Stage, panel: Panel) -> int:
    """Send all requests; the number of wrong responses."""
    stage.introduce()
    right = [await stage.first(FIRST_QUESTION), await stage.panel_asks(panel, FIRST_QUESTION)]
    for chapter in CHAPTERS:
        print(f"\n{chapter.heading}\n")
        right += [await stage.ask(question) for question in chapter.questions]
    right.append(await stage.ask_all_at_once())
    wrong = right.count(False)
    print(f"\n{len(right)} requests, {wrong} wrong or missing responses.")
    return wrong


@asynccontextmanager
async def _simulators(lines: Iterable[DemoLine], folder: Path) -> AsyncIterator[None]:
    """Start a process for each line, with its devices behind a virtual serial port in `folder`."""
    processes: dict[str, asyncio.subprocess.Process] = {}
    try:
        for line in lines:
            processes[line.name] = await _simulator(line, folder)
        for name, process in processes.items():
            async with _starting(f"the simulator of the line {name}"):
                if not process.stdout or not await process.stdout.readline():
                    raise DemoError(f"the simulator of the line {name} did not start")
        yield
    finally:
        for process in processes.values():
            if process.returncode is None:
                process.terminate()
        for process in processes.values():
            await process.wait()


async def _simulator(line: DemoLine, folder: Path) -> asyncio.subprocess.Process:
    words = ["-m", "gateway.cli.main", "simulate", *line.simulate, "--port", str(folder / line.name)]
    return await asyncio.create_subprocess_exec(
        sys.executable,
        *words,
        stdout=asyncio.subprocess.PIPE,
        stdin=asyncio.subprocess.DEVNULL,
        start_new_session=True,
        # The package may be in a folder that only PYTHONPATH of this process names.
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )


@asynccontextmanager
async def _starting(what: str) -> AsyncIterator[None]:
    """Give what starts inside the context a deadline."""
    try:
        async with asyncio.timeout(_STARTING_DEADLINE):
            yield
    except TimeoutError:
        raise DemoError(f"{what} did not start within {_STARTING_DEADLINE:g} s") from None


def _write_config(folder: Path, lines: Sequence[DemoLine], certificates: Path | None, login: Login | None) -> Path:
    """Write the config as a user would."""
    parts = [f'site = "{SITE}"\n', f'[[listen]]\nbind = "tcp://127.0.0.1:{_port(_PORT)}"\n']
    named = [*((line.name, line.config) for line in lines), (PANEL, PANEL_LINE)]
    parts += [f'[[line]]\nname = "{name}"\nport = "{folder / name}"\n{config}\n' for name, config in named]
    parts += [IMAGE, virtual_unit(LIVE_MAPPED if len(lines) > len(LINES) else ())]
    if certificates is not None:
        parts.append(tls_config(certificates, _port(TLS_PORT)))
    if login is not None:
        parts.append(page_config(_port(_PAGE_PORT), login))
    file = folder / "gateway.toml"
    file.write_text("\n".join(parts), encoding="utf-8")
    return file


def _port(wanted: int) -> int:
    """Find a port that nobody listens on: this one, else any."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        return wanted if probe.connect_ex(("127.0.0.1", wanted)) != 0 else 0


def _control(folder: Path) -> Path:
    """Choose the control socket: the default path, unless another gateway uses it."""
    usual = usual_socket()
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(usual))
        except (FileNotFoundError, ConnectionRefusedError):
            return usual if _may_write(usual.parent) else folder / "control.sock"
        except OSError:
            pass
    return folder / "control.sock"


def _may_write(folder: Path) -> bool:
    existing = next(each for each in (folder, *folder.parents) if each.exists())
    return os.access(existing, os.W_OK)


def _plan(config: Path) -> tuple[Plan, str]:
    """Load the plan of a file, and its text."""
    loaded = load(config)
    if loaded.plan is None:
        raise DemoError("\n".join(map(str, loaded.problems)))
    return loaded.plan, loaded.text


@asynccontextmanager
async def _gateway(config: Path, text: str, plan: Plan, stage: Stage) -> AsyncIterator[tuple[Running, Operator]]:
    """Run the gateway of `plan`; its events go to `stage`."""
    ready = asyncio.Event()

    def tell(event: events.Event) -> None:
        stage.tell(event)
        if isinstance(event, events.Ready):
            ready.set()

    fan_out = FanOut(tell)
    contexts = TlsStore()
    contexts.adopt(load_all(plan.secured))
    running, stop = Running(plan, make_opener, fan_out.emit, contexts=contexts), Stop()
    reloader = Reloader(config, running, Notifier({}), text=text, read=read_here)
    operator = Operator(running, reloader, events=fan_out.last)
    pages = web_pages(plan.web, operator, fan_out)
    serving = asyncio.create_task(serve(running, stop, None, reloader, pages), name="gateway")
    try:
        async with _starting("the gateway"):
            await ready.wait()
        yield running, operator
    finally:
        stop.order("the demo is stopping")
        await serving
