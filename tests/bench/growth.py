"""What a step costs, against the size of what it is taken in: a queue, a mirror, a number of lines, a config.

    .venv/bin/python tests/bench/growth.py                               every row: a quarter of an hour
    .venv/bin/python tests/bench/growth.py refusal ranges --json FILE
    .venv/bin/python tests/bench/growth.py --check                       what must not grow, at two sizes: half a minute

Most rows are parts of the gateway without sockets and clock (`grown.py`). They are built and asked in one process under
valgrind, which counts the instructions of some steps. The lines are whole gateways, as in `instructions.py`. Other work
on the machine moves neither. Commands are processes: their processor time, the least of three.

What is checked costs at most FLAT times as much at the one size as at the other. A bound for both, where there is one,
is in `instructions.toml`, for one version of Python.
"""

import argparse
import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import programs
from instructions import BOUNDS, TOLERANCE, WAYS, compile_counter, instructions

#: How many times as much a step may cost at one of the sizes that are checked as at another.
FLAT = 1.1
#: How long all rows may take in one process, in seconds.
PATIENCE = 900
#: Tests and their kit, which the rows are built with.
TESTS = programs.HERE.parent

#: The figure of each size.
Figures = dict[int, float]


@dataclass(frozen=True, kw_only=True)
class Row:
    """A step at some `sizes`, which count `of`; its bound is checked at those of `check`. `measure` gives `unit`s."""

    what: str
    of: str
    sizes: tuple[int, ...]
    measure: Callable[[str, tuple[int, ...]], Figures]
    check: tuple[int, ...] = ()
    unit: str = "instructions"


def counted(row: str, sizes: tuple[int, ...]) -> Figures:
    """Instructions of a step of `grown.ROWS`."""
    with tempfile.TemporaryDirectory(prefix="growth.") as name:
        folder = Path(name)
        compile_counter(folder)
        watch = ["valgrind", "--quiet", "--tool=callgrind", "--instr-atstart=no"]
        command = [*watch, f"--callgrind-out-file={folder}/counted", sys.executable, "-P", programs.HERE / "grown.py"]
        paths = [*filter(None, [os.environ.get("PYTHONPATH")]), str(TESTS)]
        environment = {**os.environ, "PYTHONHASHSEED": "0", "PYTHONPATH": os.pathsep.join(paths)}
        words = [*command, folder / "count.so", row, *map(str, sizes)]
        steps = subprocess.run(words, check=True, timeout=PATIENCE, env=environment, stdout=subprocess.PIPE).stdout
        totals = [
            int(re.search(r"^totals: (\d+)", (folder / f"counted.{number}").read_text(), re.MULTILINE)[1])
            for number, _ in enumerate(sizes, 1)
        ]
    return {size: total / int(steps) for size, total in zip(sizes, totals, strict=True)}


def lines(_: str, sizes: tuple[int, ...]) -> Figures:
    """Instructions of an answer of a whole gateway with so many lines, none of which is paced; 8 requests in flight."""
    found = {}
    with tempfile.TemporaryDirectory(prefix="growth.") as name:
        tools = Path(name)
        programs.compile_into(tools)
        compile_counter(tools)
        for size in sizes:
            of_lines = replace(WAYS["ports8"].lines, lines=size, units="1-3")
            units = [of_lines.line_step * line + unit for line in range(size) for unit in (1, 2, 3)]
            found[size] = instructions(replace(WAYS["ports8"], units=units, lines=of_lines), tools)
    return found


def check(_: str, sizes: tuple[int, ...]) -> Figures:
    """Processor seconds of `modbus-gateway check` for a config with so many points."""
    with tempfile.TemporaryDirectory(prefix="growth.") as name:
        file = Path(name) / "gateway.toml"
        return {size: _least_time(file, _points(size)) for size in sizes}


def _points(number: int) -> str:
    """A config with so many points, a hundred for each device, of which a line has 25 at most."""
    devices, rest = divmod(number, 100)
    text = ""
    for device in range(devices + bool(rest)):
        if device % 25 == 0:
            text += f'[[line]]\nname = "line{device // 25}"\nport = "/dev/ttyS{device // 25}"\nbaud = 19200\n'
        known_as = f"as = {device + 1}" if device < 247 else ""
        points = (f'{{ name = "p{at}", holding = {at} }}' for at in range(100 if device < devices else rest))
        text += f'[[line.devices]]\nname = "meter{device}"\nunit = {device % 25 + 1}\n{known_as}\n'
        text += f"points = [{', '.join(points)}]\n"
    return text


def _least_time(file: Path, config: str) -> float:
    file.write_text(config)
    spent = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([*programs.GATEWAY[:-1], "check", file], check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(spent)


ROWS = {
    "refusal": Row(
        what="a refusal",
        of="requests in the queue",
        sizes=(64, 256, 1024, 4096, 10_000),
        measure=counted,
        check=(64, 1024),
    ),
    "loss": Row(
        what="a request for which another one is refused",
        of="requests in the queue",
        sizes=(64, 256, 1024, 4096, 10_000),
        measure=counted,
    ),
    "mirror": Row(
        what="a read of a mirror", of="ranges", sizes=(10, 100, 1000, 5000), measure=counted, check=(10, 1000)
    ),
    "map": Row(what="a read of a virtual unit", of="rows", sizes=(10, 100, 1000, 5000), measure=counted),
    "poll": Row(what="a poll of a mirror", of="ranges", sizes=(10, 100, 1000, 5000), measure=counted),
    "write": Row(what="a write to an image", of="registers", sizes=(100, 10_000, 65_536), measure=counted),
    "clients": Row(what="an answer", of="clients of a line", sizes=(8, 64, 512, 2000), measure=counted),
    "ranges": Row(
        what="a read of a mirror that is not remembered", of="ranges", sizes=(10, 100, 1000, 5000), measure=counted
    ),
    "written": Row(what="a write through a mirror", of="ranges", sizes=(10, 100, 1000, 5000), measure=counted),
    "row": Row(
        what="a write to a row of a map, and a read of the freshness of its device",
        of="rows",
        sizes=(10, 100, 1000, 5000),
        measure=counted,
    ),
    "lines": Row(what="an answer", of="lines that are not paced", sizes=(8, 16, 32, 64), measure=lines),
    "check": Row(what="`check`", of="points", sizes=(0, 100, 1000, 10_000), measure=check, unit="s"),
}


def main() -> int:
    """Measure the rows named on the command line."""
    args = _arguments()
    programs.compile_gateway()
    bounds = tomllib.loads(BOUNDS.read_text())
    is_comparable = bounds["python"] == f"{sys.version_info.major}.{sys.version_info.minor}"
    names = [name for name in args.rows or ROWS if ROWS[name].check or not args.check]
    found = {}
    exceeded = has_grown = False
    print("| step | of | size: cost |\n|---|---|---|")
    for name in names:
        row = ROWS[name]
        figures = found[name] = row.measure(name, row.check if args.check else row.sizes)
        cells = ", ".join(
            f"{size}: {figure:.4g}" if row.unit == "s" else f"{size}: {figure:.0f}" for size, figure in figures.items()
        )
        bound = bounds["growth"].get(name)
        print(f"| {row.what} | {row.of} | {cells} {row.unit}{f'; bound {bound}' if bound else ''} |", flush=True)
        if args.check and max(figures.values()) > FLAT * min(figures.values()):
            print(f"{row.what}: it grows with {row.of}", file=sys.stderr)
            has_grown = True
        exceeded |= args.check and bool(bound) and max(figures.values()) > bound * (1 + TOLERANCE)
    if args.json:
        args.json.write_text(json.dumps(_as_json(found), indent=1) + "\n")
    if not is_comparable:
        print(f"the bounds are those of Python {bounds['python']}: not compared", file=sys.stderr)
        return 1 if has_grown else 0
    if exceeded:
        print(f"more than the bound in {BOUNDS.name}, by over {TOLERANCE:.0%}", file=sys.stderr)
    return 1 if exceeded or has_grown else 0


def _as_json(found: dict[str, Figures]) -> list[dict[str, object]]:
    """What pictures.py draws."""
    return [
        {"name": ROWS[name].what, "size": ROWS[name].of, "unit": ROWS[name].unit, "costs": figures}
        for name, figures in found.items()
    ]


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rows", nargs="*", metavar="ROW", help=f"some of {', '.join(ROWS)} (default: all)")
    parser.add_argument("--check", action="store_true", help="only what must not grow, at two sizes")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures there too")
    args = parser.parse_args()
    if unknown := set(args.rows) - set(ROWS):
        parser.error(f"no such row: {', '.join(sorted(unknown))}")
    return args


if __name__ == "__main__":
    sys.exit(main())
