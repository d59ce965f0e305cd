"""The whole gateway on virtual lines, beside a bare relay in C that stands for what no gateway can leave out.

    .venv/bin/python tests/bench/bench.py                                   every scenario, three rounds: 25 minutes
    .venv/bin/python tests/bench/bench.py table                             those of docs/performance.md: 16 minutes
    .venv/bin/python tests/bench/bench.py ports8 line19200 --rounds 1
    .venv/bin/python tests/bench/bench.py table --before ../older           in turns with another checkout's gateway
    sudo chrt -r 5 … latency19200 --busy 2 --under "chrt -o 0 nice -n -10"  beside busy programs, and not before them
    PYTHONPATH=. .venv/bin/python tests/bench/bench.py ports8 --before .    not compiled, in turns with compiled
    .venv/bin/python tests/bench/bench.py --list

Needs a C compiler and Linux. Devices and load run on the first processor, what is measured on the second; with less, or
with other work on the machine, only the ratios and `of line` mean something: what is compared was measured in turns.
On a paced line there is a second relay, which wakes up for each byte. Ends with status 1 when an answer was wrong or an
exception or did not come, or a line was not kept silent as long as it must be; a missed goal is only shown.

What the columns are, and figures: docs/performance.md.
"""

import argparse
import resource
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from measure import FAULTS, Figures, run, together
from programs import GATEWAY as OURS
from programs import BenchError, Words, busy, compile_gateway, compile_into, gateway_of
from scenarios import SCENARIOS, TABLE, Scenario

#: What is measured in turns; `before` and the line itself only where they are asked for.
GATEWAY, BEFORE, RELAY, EACH_BYTE, DIRECT = "gateway", "before", "relay", "relay, each byte", "the line itself"
#: What measure.py calls them.
AS = {RELAY: "relay", EACH_BYTE: "each-byte", DIRECT: "direct"}


def _shown(figure: str, form: str) -> Callable[[Figures], str]:
    """Make a cell of a figure that may be missing, or 0."""
    return lambda figures: format(figures[figure], form) if figures.get(figure) else ""


COLUMNS = {
    "answers/s": _shown("rate", ".0f"),
    "of line": _shown("of_line", ".3f"),
    "p50 ms": _shown("p50", ".2f"),
    "p99 - p50": _shown("tail", ".2f"),
    "added ms": _shown("added", ".2f"),
    "CPU us": _shown("cpu", ".1f"),
    "x relay": _shown("x_relay", ".2f"),
    "x each byte": _shown("x_each_byte", ".2f"),
    "of a core": _shown("load", ".1%"),
    "MiB": _shown("memory", ".1f"),
    "silence": _shown("silence", ".2f"),
    "faults": lambda figures: _faults(figures) or "0",
}


def main() -> int:
    """Run the scenarios named on the command line."""
    args = _arguments()
    if args.list:
        for name, scenario in SCENARIOS.items():
            print(f"{name:14}{'table ' if name in TABLE else '      '}{scenario.what}")
        return 0
    compile_gateway(args.before)
    _allow_many_descriptors()
    gateways = {GATEWAY: [*args.under.split(), *OURS]}
    if args.before:
        gateways[BEFORE] = gateway_of(args.before)
    failures = 0
    with tempfile.TemporaryDirectory(prefix="bench.") as name, busy(args.busy):
        tools = Path(name)
        compile_into(tools)
        print("| scenario | |", " | ".join(COLUMNS), "| remarks |")
        print("|---|---|" + "---:|" * len(COLUMNS) + "---|")
        for title in args.scenarios or SCENARIOS:
            scenario = SCENARIOS[title]
            if args.seconds:
                scenario = replace(scenario, seconds=args.seconds)
            try:
                found = _measure(scenario, tools, args.rounds, gateways)
            except BenchError as error:
                print(f"| {title} | {error} |", flush=True)
                failures += 1
                continue
            for kind, figures in found.items():
                cells = " | ".join(make(figures) for make in COLUMNS.values())
                print(f"| {title} | {kind} | {cells} | {_remarks(scenario, kind, found)} |", flush=True)
            failures += any(_faults(figures) for figures in found.values())
    return 1 if failures else 0


def _measure(scenario: Scenario, tools: Path, rounds: int, gateways: dict[str, Words]) -> dict[str, Figures]:
    """The figures of all that is measured in turns, and how they compare."""
    kinds = [*gateways, RELAY, *[EACH_BYTE] * bool(scenario.baud)]
    kinds += [DIRECT] * scenario.has_direct
    runs: dict[str, list[Figures]] = {kind: [] for kind in kinds}
    for number in range(rounds):
        for kind in kinds if number % 2 else kinds[::-1]:
            asked = scenario.for_relay if kind in (RELAY, EACH_BYTE) else scenario
            runs[kind].append(run(asked, tools, AS.get(kind, "gateway"), program=gateways.get(kind, OURS)))
    found = {kind: together(each) for kind, each in runs.items()}
    for figures in found.values():
        figures["of_relay"] = figures["rate"] / found[RELAY]["rate"]
        figures["below_relay"] = found[RELAY]["of_line"] - figures["of_line"]
        figures["x_relay"] = figures["cpu"] / found[RELAY]["cpu"]
        if EACH_BYTE in found:
            figures["x_each_byte"] = figures["cpu"] / found[EACH_BYTE]["cpu"]
        if DIRECT in found:
            figures["added"] = figures["p50"] - found[DIRECT]["p50"]
    return found


def _remarks(scenario: Scenario, kind: str, found: dict[str, Figures]) -> str:
    ours = found[kind]
    if kind not in (GATEWAY, BEFORE):
        return ""
    remarks = [
        f"{goal.figure} {ours[goal.figure]:.2f}, goal {goal}{'' if goal.is_met(ours[goal.figure]) else ': MISSED'}"
        for goal in scenario.goals
    ]
    if ours["refused"]:
        remarks.append(
            f"{ours['refused']:.0f} refused a second, at most {1e6 * ours['load'] / ours['refused']:.0f} us each"
        )
    if kind == GATEWAY and BEFORE in found:
        remarks.append(f"{ours['cpu'] / found[BEFORE]['cpu']:.2f} of the CPU before")
    return "; ".join(remarks)


def _faults(figures: Figures) -> str:
    return ", ".join(f"{figures[fault]:.0f} {fault.replace('_', ' ')}" for fault in FAULTS if figures[fault])


def _allow_many_descriptors() -> None:
    """A thousand connections for the programs that are started."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, 8192), hard), hard))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="What the columns are: docs/performance.md"
    )
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="some of --list, or table (default: all)")
    parser.add_argument("--rounds", type=int, default=3, help="how often each is measured")
    parser.add_argument("--seconds", type=float, help="how long each round takes, instead of the scenario's own")
    parser.add_argument(
        "--before", type=Path, metavar="FOLDER", help="a checkout whose gateway takes turns with this one"
    )
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="beside so many programs in an endless loop")
    parser.add_argument("--under", default="", metavar="WORDS", help="words before the command of the gateway")
    parser.add_argument("--list", action="store_true", help="show the scenarios")
    args = parser.parse_args()
    args.scenarios = [name for each in args.scenarios for name in (TABLE if each == "table" else (each,))]
    if unknown := set(args.scenarios) - set(SCENARIOS):
        parser.error(f"no such scenario: {', '.join(sorted(unknown))}; see --list")
    return args


if __name__ == "__main__":
    sys.exit(main())
