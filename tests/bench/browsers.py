"""What browsers on the pages cost: 8 lines at their full rate, without a page, with it, and with 20 browsers on it.

    .venv/bin/python tests/bench/browsers.py                 three rounds, five minutes
    .venv/bin/python tests/bench/browsers.py --rounds 0      only what each page weighs

The browsers ask for what a page asks for, as often, and read it: half of them that of the overview, half that of a
line. Devices, load and browsers run on the first processor, the gateway on the second. (A Chromium beside devices and
load slows them by 1.6 %, while the gateway takes 12.6 % of its own processor instead of 11.4 %: none runs here.) The
goal is a rate within MOST_LOST of that without browsers. On a busy machine more rounds help, and the share of the
relay's rate says what the machine could do (`bench.py lines8`).

Then, for each page, by Chromium: first contentful paint and all bytes that came, with an empty cache.
"""

import argparse
import asyncio
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any

import measure
import programs
from measure import FAULTS, Figures
from programs import BenchError
from scenarios import SCENARIOS

sys.path.append(str(Path(__file__).parents[1]))

from kit.chromium import chromium
from kit.programs import find

BROWSERS = 20
#: How much of the lines' rate may be lost to them.
MOST_LOST = 0.01
#: The goals of a page: milliseconds and bytes.
MOST_TIME, MOST_BYTES = 300.0, 200 * 1024
#: A page asks for itself again after so many seconds, as `static/page.js` does.
EVERY = 5.0
#: 160 units, as many as the load can tell apart.
SCENARIO = replace(SCENARIOS["lines8"], units="1-20", warmup=6.0, seconds=20.0)
PAGES = ("/", "/lines/line0", "/units/1", "/traffic", "/health", "/clients", "/config", "/login")


def main() -> int:
    """Measure, and print; 1 if a goal was missed."""
    args = _arguments()
    if args.look:
        asyncio.run(_look(args.look, args.words[0], args.words[1:]))
        return 0
    if args.rounds:
        programs.compile_gateway()
    with tempfile.TemporaryDirectory(prefix="bench.") as name:
        tools = Path(name)
        programs.compile_into(tools)
        is_good = _compare(tools, args.rounds) if args.rounds else True
        return 0 if _weigh(tools) and is_good else 1


def _compare(tools: Path, rounds: int) -> bool:
    """Print what browsers cost; whether the lines kept their rate."""
    runs: dict[str, list[Figures]] = {"no page": [], "nobody": [], f"{BROWSERS} browsers": []}
    for number in range(rounds):
        for kind in list(runs)[:: 1 if number % 2 else -1]:
            runs[kind].append(_run(tools, kind))
    print("| | answers/s | of line | p99 ms | of a core | CPU us an answer | MiB | pages/s | KiB/s to browsers |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for kind, each in runs.items():
        f = measure.together(each) | {name: median(run[name] for run in each) for name in ("pages", "bytes")}
        print(
            f"| {kind} | {f['rate']:.0f} | {f['of_line']:.3f} | {f['p99']:.1f} | {f['load']:.1%} | {f['cpu']:.0f} | "
            f"{f['memory']:.1f} | {f['pages']:.1f} | {f['bytes'] / 1024:.0f} |",
            flush=True,
        )
    without, with_them = (median(each["of_line"] for each in runs[kind]) for kind in list(runs)[1:])
    print(f"\nlost to the browsers: {1 - with_them / without:.2%} of the rate, goal {MOST_LOST:.0%}\n")
    faults = sum(run[fault] for each in runs.values() for run in each for fault in FAULTS)
    return faults == 0 and with_them >= without * (1 - MOST_LOST)


def _run(tools: Path, kind: str) -> Figures:
    page = 0 if kind == "no page" else programs.free_port()
    looked: dict[str, float] = {"pages": 0.0, "bytes": 0.0}
    beside = _looking(page, looked) if kind.endswith("browsers") else None
    more = f'\n[web]\nbind = "http://127.0.0.1:{page}"\n' if page else ""
    return measure.run(SCENARIO, tools, "gateway", more, beside) | looked


@contextmanager
def _looking(port: int, looked: dict[str, float]) -> Iterator[None]:
    """In its context browsers look at the pages; what they got a second is in `looked` at the end."""
    lines = [f"line{number}" for number in range(SCENARIO.lines)]
    command = [sys.executable, __file__, "--look", str(BROWSERS), f"http://127.0.0.1:{port}", *lines]
    program = programs.start(command, programs.processors()[0], stdout=-1)
    try:
        yield
    finally:
        looked |= json.loads(programs.end(program) or "{}")


@dataclass(slots=True)
class _Looked:
    """What browsers got."""

    pages: int = 0
    bytes: int = 0
    began: float = field(default_factory=time.monotonic)


async def _look(browsers: int, address: str, lines: list[str]) -> None:
    """Look at the pages until the end of this process is asked for."""
    # They run when devices and load do not want to: it is the gateway that is measured. (Another program that uses a
    # fifth of that processor, even at nice 10, costs the lines 1.2 % of their rate, without any page.)
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    looked, loop = _Looked(), asyncio.get_running_loop()
    port = int(address.rpartition(":")[2])
    tasks = []
    for number in range(browsers):
        line = lines[number % len(lines)] if number % 2 else ""
        tasks += [asyncio.create_task(_pages(port, line, looked)), asyncio.create_task(_stream(port, line, looked))]
    over = loop.create_future()
    loop.add_signal_handler(15, over.set_result, None)
    await asyncio.wait([over, *tasks], return_when=asyncio.FIRST_COMPLETED)
    seconds = time.monotonic() - looked.began
    print(json.dumps({"pages": looked.pages / seconds, "bytes": looked.bytes / seconds}))
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


async def _pages(port: int, line: str, looked: _Looked) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    while True:
        writer.write(_request(port, f"/lines/{line}" if line else "/"))
        head = (await reader.readuntil(b"\r\n\r\n")).lower()
        if not head.startswith(b"http/1.1 200"):
            raise ConnectionError(head.decode())
        size = int(head.partition(b"content-length: ")[2].split(b"\r\n")[0])
        await reader.readexactly(size)
        looked.pages += 1
        looked.bytes += len(head) + size
        await asyncio.sleep(EVERY)


async def _stream(port: int, line: str, looked: _Looked) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(_request(port, f"/api/v1/trace?seconds=20{f'&line={line}' if line else ''}"))
    while data := await reader.read(65536):
        looked.bytes += len(data)
    raise ConnectionError("dropped")


def _request(port: int, path: str) -> bytes:
    return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nAccept-Encoding: gzip\r\n\r\n".encode()


def _weigh(tools: Path) -> bool:
    """Print what each page weighs; whether all keep the goals."""
    if find("chromium") is None:
        print("Chromium is not installed: the pages were not weighed (apt install chromium-headless-shell)")
        return True
    weights: dict[str, tuple[float, int, int]] = {}
    port = programs.free_port()
    short = replace(SCENARIO, warmup=1.0, seconds=3.0 * len(PAGES))
    measure.run(short, tools, "gateway", f'\n[web]\nbind = "http://127.0.0.1:{port}"\n', _weighing(port, weights))
    print("| page | first paint ms | KiB | requests |\n|---|---:|---:|---:|")
    for path, (paint, size, requests) in weights.items():
        print(f"| `{path}` | {paint:.0f} | {size / 1024:.1f} | {requests} |")
    return all(paint <= MOST_TIME and size <= MOST_BYTES for paint, size, _ in weights.values())


@contextmanager
def _weighing(port: int, weights: dict[str, tuple[float, int, int]]) -> Iterator[None]:
    with chromium() as browser:
        for path in PAGES:
            weights[path] = _weight(browser, f"http://127.0.0.1:{port}{path}")
        yield


def _weight(browser: Any, address: str) -> tuple[float, int, int]:
    """First contentful paint in milliseconds (the median of five), bytes, and requests."""
    paints = []
    for _ in range(5):
        context = browser.new_context()
        page = context.new_page()
        sizes: list[int] = []
        session = context.new_cdp_session(page)
        session.send("Network.enable")
        session.on("Network.loadingFinished", lambda event, sizes=sizes: sizes.append(int(event["encodedDataLength"])))
        if not page.goto(address).ok:
            raise BenchError(f"there is no {address}")
        page.wait_for_timeout(500)
        paints.append(page.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? 1e9"))
        context.close()
    return median(paints), sum(sizes), len(sizes)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=3, help="how often each is measured")
    parser.add_argument("--look", type=int, help=argparse.SUPPRESS)
    parser.add_argument("words", nargs="*", help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
