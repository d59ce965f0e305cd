"""What a read costs the gateway in instructions and in system calls: figures that other work does not move.

    .venv/bin/python tests/bench/instructions.py                       every way: two minutes
    .venv/bin/python tests/bench/instructions.py image line --check    whether they exceed their bounds

The whole gateway runs under `valgrind --tool=callgrind`, which counts while the clients read, and under `strace -c`,
once with few reads and once with many, of which the difference counts. Needs both programs, a C compiler and Linux.

What counts is all that the gateway executes outside of the kernel. valgrind makes it fifty times as slow, and other
work slower still. So that neither decides what there is to do, the gateway does not go on before clients and devices
have done what they can, finds clients before lines, and has a clock of its own (`count.c`): each response of a line is
a wait of the gateway, one read of the port, and one of the client that asks again. Only `paced` has real time, and the
figures of system calls have.

What is left is luck. Python finds the attributes of classes in a table with places for 4096, and two that meet in one
place cost 240 instructions whenever either is needed. Which of them do depends on where they are in memory, and so on
each start and each change of the code. So what exceeds its bound is counted again, at most TRIES times, with other
places in memory, and the least counts: what the code itself costs is in each of them. Figures of two runs differ by
half a hundredth; those of another version of Python, or of another compiler, by more. Debian's Python 3.11, built with
optimisation by profiles and at link time, takes a tenth less than one without. The same compiled modules run in it:

    PYTHONPATH=.venv/lib/python3.11/site-packages /usr/bin/python3 tests/bench/instructions.py line image

Bounds are in `instructions.toml`. What they mean, and figures: docs/performance.md.
"""

import argparse
import os
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from struct import pack, unpack_from

import programs
from programs import BenchError
from scenarios import Scenario

#: The bound of each way, in instructions; how much more it may be, as a share.
BOUNDS = Path(__file__).with_suffix(".toml")
TOLERANCE = 0.03
#: How often what exceeds its bound is counted at most.
TRIES = 3
#: How many registers are read at once, and how many requests are in flight: for each answer another one is asked.
COUNT = 10
IN_FLIGHT = 8
#: The most registers of a read.
MOST = 125
#: No gateway takes longer to start, to answer or to end under valgrind, in seconds.
PATIENCE = 120.0
#: More ranges than a mirror remembers reads, and how far their first addresses are apart.
RANGES = 1100
APART = COUNT + 3
#: The system calls that are named in the table.
NAMED = ("read", "write", "recvfrom", "sendto", "epoll_wait", "epoll_pwait2", "epoll_ctl")


#: How far the gateway's clock goes on at each wait, in nanoseconds.
QUICK = 1_000_000
#: So far that each response comes after more than 50 ms, as on a real line: the client is looked at before it leaves.
SLOW = 7_000_000


@dataclass(frozen=True, kw_only=True)
class Way:
    """Reads of `units`, as clients know them, `many` of them after a `few`; `lines` carry them, `more` is config.

    Each read is of `count` registers. The next one is `apart` from it, one of `places`.

    `clients` share what is `in_flight`. `step` is how far the gateway's clock goes on at each wait, 0 for real time.
    """

    what: str
    units: Sequence[int]
    lines: Scenario
    clients: int = 1
    in_flight: int = IN_FLIGHT
    more: str = ""
    count: int = COUNT
    apart: int = 0
    places: int = 0
    #: The device whose value the clients get at an address of the only unit; 0 for zeros.
    values_of: Callable[[int], int] = lambda _: 1
    step: int = QUICK
    few: int = 400
    many: int = 2000

    @property
    def answer_size(self) -> int:
        """The size of an answer: header, unit, function, byte count, values."""
        return 9 + 2 * self.count

    @property
    def addresses(self) -> range:
        """What is read: the gateway knows all requests after the first run, unless there are very many."""
        return range(0, self.places * self.apart, self.apart) if self.places else range(0, 100, self.count)


def _lines(number: int, **more: object) -> Scenario:
    return Scenario(what="", clients=IN_FLIGHT, lines=number, count=COUNT, timeout=20_000, **more)  # type: ignore[arg-type]


def _rows() -> Iterator[str]:
    """Rows of two registers, the last one of three, from the same addresses of one device after the other."""
    for row in range(MOST // 2):
        first, last = 2 * row, 2 * row + 1 if row < MOST // 2 - 1 else MOST - 1
        yield f'{{ at = {first}, device = "line0-{_device(row)}", holding = "{first}-{last}", every = "30 s" }}'


def _ranges() -> Iterator[str]:
    """Ranges that are polled with others."""
    return (f'{{ holding = "{at}-{at + COUNT - 1}", every = "1 h" }}' for at in range(0, RANGES * APART, APART))


def _points() -> Iterator[str]:
    return (f'{{ name = "p{at}", holding = {at} }}' for at in range(100))


def _device(row: int) -> int:
    return 1 + min(row, MOST // 2 - 1) % 20


WAYS = {
    "image": Way(
        what="an image",
        units=range(200, 201),
        lines=_lines(0),
        more='[[image]]\nunit = 200\nholding = "0-999"\n',
        values_of=lambda _: 0,
    ),
    "mirror": Way(
        what="a mirror",
        units=range(200, 201),
        lines=_lines(1),
        more='[[image]]\nunit = 200\nof = "line0-1"\nread = [{ holding = "0-124", every = "30 s" }]\nstale = "90 s"\n',
    ),
    "ranges": Way(
        what="a mirror of 1100 ranges, each after all others",
        units=range(200, 201),
        lines=_lines(1),
        more='[profile.generic]\nmax_gap = 3\n[[image]]\nunit = 200\nof = "line0-1"\nstale = "3 h"\n'
        f"read = [{', '.join(_ranges())}]\n",
        apart=APART,
        places=RANGES,
        few=RANGES + 400,
    ),
    "virtual": Way(
        what="a virtual unit, 125 registers of 62 rows and 20 devices",
        units=range(200, 201),
        lines=_lines(1, units="1-20"),
        more=f'[[image]]\nunit = 200\nstale = "90 s"\nmap = [{", ".join(_rows())}]\n',
        count=MOST,
        values_of=lambda address: _device(address // 2),
    ),
    "line": Way(what="an RTU line", units=range(1, 9), lines=_lines(1)),
    "points": Way(
        what="an RTU line, devices with 100 points",
        units=range(1, 9),
        lines=_lines(1),
        more=f"[profile.generic]\npoints = [{', '.join(_points())}]\n",
    ),
    "slow": Way(what="an RTU line, each after 50 ms", units=range(1, 9), lines=_lines(1), step=SLOW),
    "ascii": Way(what="an ASCII line", units=range(1, 9), lines=_lines(1, is_ascii=True)),
    "clients": Way(what="an RTU line, by 8 clients", units=range(1, 9), clients=IN_FLIGHT, lines=_lines(1)),
    "ports8": Way(what="8 RTU lines, by 8 clients", units=range(1, 161), clients=IN_FLIGHT, lines=_lines(8)),
    "upstream": Way(
        what="another Modbus TCP server, one by one",  # how many answers it finds at once would be luck
        units=range(1, 9),
        lines=_lines(1, behind_server=True),
        in_flight=1,
    ),
    "paced": Way(
        what="an RTU line of 19200 baud",
        units=range(1, 9),
        lines=_lines(1, baud=19200),
        step=0,
        few=60,
        many=300,
    ),
}


def main() -> int:
    """Measure the ways named on the command line."""
    args = _arguments()
    programs.compile_gateway()
    bounds = tomllib.loads(BOUNDS.read_text())
    is_comparable = bounds["python"] == f"{sys.version_info.major}.{sys.version_info.minor}"
    titles = ["bound", *NAMED, "all"] if not args.check else ["bound"]
    print(f"| a read through | instructions | {' | '.join(titles)} |\n|---|" + "---:|" * (len(titles) + 1))
    exceeded = 0
    with tempfile.TemporaryDirectory(prefix="instructions.") as name:
        tools = Path(name)
        programs.compile_into(tools)
        compile_counter(tools)
        for title in args.ways or WAYS:
            way = WAYS[title] if args.count is None else replace(WAYS[title], count=args.count)
            count = least_instructions(way, tools, bounds[title] * (1 + TOLERANCE))
            cells = [f"{count:.0f}", f"{bounds[title]}"]
            if not args.check:
                calls = system_calls(way, tools)
                cells += [f"{calls.get(call, 0.0):.2f}" for call in (*NAMED, "total")]
            print(f"| {way.what} | {' | '.join(cells)} |", flush=True)
            exceeded += count > bounds[title] * (1 + TOLERANCE)
    if not is_comparable:
        print(f"the bounds are those of Python {bounds['python']}: not compared", file=sys.stderr)
        return 0
    if exceeded:
        print(f"more than the bound in {BOUNDS.name}, by over {TOLERANCE:.0%}", file=sys.stderr)
    return 1 if exceeded else 0


def least_instructions(way: Way, tools: Path, most: float) -> float:
    """The same as `instructions`; of several runs the least, as long as it is more than `most`."""
    counts: list[float] = []
    while not counts or (min(counts) > most and len(counts) < TRIES):
        counts.append(instructions(way, tools, layout=len(counts)))
    if len(counts) > 1:
        print(f"{way.what}: {', '.join(f'{count:.0f}' for count in counts)}", file=sys.stderr)
    return min(counts)


def instructions(way: Way, tools: Path, layout: int = 0) -> float:
    """Instructions of the gateway, without the kernel's, for each read."""
    return int(re.search(r"^totals: (\d+)", profile(way, tools, layout), re.MULTILINE)[1]) / way.many


def profile(way: Way, tools: Path, layout: int = 0) -> str:
    """What callgrind counted in `many` reads, with one `layout` of memory of several."""
    watch = ["valgrind", "--quiet", "--tool=callgrind", "--instr-atstart=no", "--callgrind-out-file={}/counted"]
    with _running(way, tools, watch, layout) as (gateway, port, folder):
        _read(way, port, way.few)
        gateway.send_signal(signal.SIGUSR1)
        _read(way, port, way.many)
        gateway.send_signal(signal.SIGUSR2)
        counted = _written(folder / "counted.1", "totals: ")
        gateway.kill()
    return counted


def system_calls(way: Way, tools: Path) -> dict[str, float]:
    """System calls of the gateway for each read, by name, and `total`."""
    few, many = _calls(way, tools, way.few), _calls(way, tools, way.few + way.many)
    return {name: (count - few.get(name, 0)) / way.many for name, count in many.items()}


def _calls(way: Way, tools: Path, reads: int) -> dict[str, int]:
    with _running(way, tools, ["strace", "-D", "-f", "-c", "-o", "{}/counted"]) as (gateway, port, folder):
        _read(way, port, reads)
        gateway.terminate()
        gateway.wait(PATIENCE)
        rows = [line.split() for line in _written(folder / "counted", " total\n").splitlines()]
    return {row[-1]: int(row[3]) for row in rows if len(row) >= 5 and row[3].isdigit()}


@contextmanager
def _running(way: Way, tools: Path, watch: list[str], layout: int = 0) -> Iterator[tuple[subprocess.Popen, int, Path]]:
    """A gateway that `watch` has started, its port and its folder, which is `{}` in `watch`."""
    with (
        tempfile.TemporaryDirectory(prefix="instructions.") as name,
        _devices(way, tools, Path(name)) as (places, simulators),
    ):
        folder, port = Path(name), programs.free_port()
        file, log = folder / "gateway.toml", folder / "gateway.log"
        file.write_text(programs.config(way.lines, folder, places, port) + way.more)
        command = [*(word.format(folder) for word in watch), *programs.GATEWAY, file]
        with log.open("w") as output:
            environment = _environment(tools, way.step, [os.getpid(), *simulators], layout)
            gateway = subprocess.Popen(command, stdout=output, stderr=output, env=environment)
        try:
            programs.wait_for_listener(port, gateway, PATIENCE)
            yield gateway, port, folder
        except (BenchError, OSError) as error:
            raise BenchError(f"{error}; the gateway's log ends: {log.read_text()[-500:]}") from error
        finally:
            gateway.kill()
            gateway.wait(PATIENCE)


def compile_counter(tools: Path) -> None:
    """Build what begins and ends counting."""
    source = programs.HERE / "count.c"
    subprocess.run([os.environ.get("CC", "cc"), "-shared", "-fPIC", "-o", tools / "count.so", source], check=True)


def _environment(tools: Path, step: int, beside: list[int], layout: int) -> dict[str, str]:
    """Modules are compiled to bytecode once, and hashes are always the same.

    For `step` and `beside` see count.c. Each further `layout` has some variables more: they move what is behind.
    """
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    moved_by = {f"LAYOUT_{number:03}": "moves what is behind it" for number in range(37 * layout)}
    ours = {
        "COUNT_STEP": str(step),
        "COUNT_BESIDE": ",".join(map(str, beside)),
        "LD_PRELOAD": str(tools / "count.so"),
        "PYTHONPYCACHEPREFIX": str(tools / "bytecode"),
        "PYTHONHASHSEED": "0",
    }
    return kept | moved_by | ours


def _written(file: Path, last: str) -> str:
    """What a program has written, once its `last` words are there. `strace` writes after the end of what it watches."""
    until = time.monotonic() + PATIENCE
    while last not in (text := file.read_text() if file.exists() else ""):
        if time.monotonic() > until:
            raise BenchError("nothing was counted")
        time.sleep(0.02)
    return text


@contextmanager
def _devices(way: Way, tools: Path, folder: Path) -> Iterator[tuple[list[str | Path], list[int]]]:
    """The ports of simulated lines, or the server that has them, and the processes that simulate them."""
    ttys = [folder / f"tty{i}" for i in range(way.lines.lines)]
    if not ttys:
        yield ttys, []
        return
    simulator = programs.start(programs.devices(way.lines, tools, ttys), programs.processors()[0], stdout=-1)
    try:
        programs.wait_for_ports(ttys, simulator)
        if way.lines.behind_server:
            with _server(way, tools, ttys) as (address, process):
                yield [address], [simulator.pid, process]
        else:
            yield [*ttys], [simulator.pid]
    finally:
        programs.end(simulator)


@contextmanager
def _server(way: Way, tools: Path, ttys: list[Path]) -> Iterator[tuple[str, int]]:
    """The address of a server in front of simulated lines, and its process."""
    port = programs.free_port()
    relay = programs.start(programs.relay(way.lines, tools, ttys, port), programs.processors()[0], stdout=-1)
    try:
        programs.wait_for_listener(port, relay)
        yield f"tcp://127.0.0.1:{port}", relay.pid
    finally:
        programs.end(relay)


def _read(way: Way, port: int, reads: int) -> None:
    """Ask so many times in all, and check each answer. A client asks again for as many as it was answered."""
    places = [(unit, address) for address in way.addresses for unit in _living(way)]
    clients = {socket.create_connection(("127.0.0.1", port), PATIENCE): b"" for _ in range(way.clients)}
    asked, answered, size = 0, 0, way.answer_size

    def ask(client: socket.socket, count: int) -> None:
        nonlocal asked
        numbers = range(asked, min(asked + count, reads))
        asked = numbers.stop
        client.sendall(b"".join(_request(way, n, *places[n % len(places)]) for n in numbers))

    for client in clients:
        ask(client, way.in_flight // way.clients)
    while answered < reads:
        ready = select.select(list(clients), [], [], PATIENCE)[0]
        if not ready:
            raise BenchError("no answer")
        for client in ready:
            received = clients[client] + client.recv(4096)
            whole = len(received) // size
            clients[client] = received[whole * size :]
            for at in range(0, whole * size, size):
                _check(received[at : at + size], places, way)
            answered += whole
            ask(client, whole)
    for client in clients:
        client.close()


def _living(way: Way) -> list[int]:
    """The units, one of each line after the other."""
    step = way.lines.line_step if way.lines.lines else 1
    return sorted((unit for unit in way.units if (unit - 1) % step < 8 or len(way.units) == 1), key=lambda u: u % step)


def _request(way: Way, number: int, unit: int, address: int) -> bytes:
    return pack(">HHHBBHH", number, 0, 6, unit, 3, address, way.count)


def _check(answer: bytes, places: list[tuple[int, int]], way: Way) -> None:
    (number,) = unpack_from(">H", answer)
    unit, address = places[number % len(places)]
    values = [_value(way, unit, address + i) for i in range(way.count)]
    expected = pack(f">HHHBBB{way.count}H", number, 0, way.answer_size - 6, unit, 3, 2 * way.count, *values)
    if answer != expected:
        raise BenchError(f"a wrong answer: {answer.hex(' ')}")


def _value(way: Way, unit: int, address: int) -> int:
    """What a device has in this register: `wire_reg` of wire.h."""
    known_as = unit if len(way.units) > 1 else way.values_of(address)
    return (known_as * 2654435761 + address * 40503 + 0x1234) & 0xFFFF if known_as else 0


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="What the figures mean: docs/performance.md"
    )
    parser.add_argument("ways", nargs="*", metavar="WAY", help=f"some of {', '.join(WAYS)} (default: all)")
    parser.add_argument("--count", type=int, metavar="N", help="registers of each read, in place of those of the way")
    parser.add_argument("--check", action="store_true", help="only what has a bound: no system calls")
    args = parser.parse_args()
    if unknown := set(args.ways) - set(WAYS):
        parser.error(f"no such way: {', '.join(sorted(unknown))}")
    return args


if __name__ == "__main__":
    sys.exit(main())
