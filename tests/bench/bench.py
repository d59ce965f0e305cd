"""The whole gateway on virtual lines, beside a bare relay in C that stands for what no gateway can leave out.

    .venv/bin/python tests/bench/bench.py                                   every scenario, three rounds: 17 minutes
    .venv/bin/python tests/bench/bench.py ports8 line19200 --rounds 1
    .venv/bin/python tests/bench/bench.py --list

Needs a C compiler and Linux. Devices and load run on the first processor, what is measured on the second; with less, or
with other work on the machine, only the columns `x relay` and `of line` mean something: relay and gateway are measured
in turns. Ends with status 1 when an answer was wrong or an exception or did not come, or a line was not kept silent as
long as it must be; a missed goal is only shown.

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
from programs import BenchError, compile_gateway, compile_into
from scenarios import SCENARIOS, Scenario

#: Title, and how the cell is made of the gateway's figures and the relay's.
Column = tuple[str, Callable[[Figures, Figures], str]]

COLUMNS: tuple[Column, ...] = (
    ("answers/s", lambda ours, _: f"{ours['rate']:.0f}"),
    ("relay", lambda _, relay: f"{relay['rate']:.0f}"),
    ("of line", lambda ours, _: f"{ours['of_line']:.3f}" if ours["of_line"] else ""),
    ("relay", lambda _, relay: f"{relay['of_line']:.3f}" if relay["of_line"] else ""),
    ("p50 ms", lambda ours, _: f"{ours['p50']:.2f}"),
    ("p99 ms", lambda ours, _: f"{ours['p99']:.2f}"),
    ("relay p99", lambda _, relay: f"{relay['p99']:.2f}"),
    ("least CPU us", lambda ours, _: f"{ours['cpu']:.1f}"),
    ("x relay", lambda ours, _: f"{ours['cpu_ratio']:.2f}"),
    ("of a core", lambda ours, _: f"{ours['load']:.0%}"),
    ("MiB", lambda ours, _: f"{ours['memory']:.1f}"),
    ("silence", lambda ours, _: f"{ours['silence']:.2f}" if ours["silence"] else ""),
    *((name.replace("_", " "), lambda ours, _, name=name: f"{ours[name]:.0f}") for name in FAULTS),
)


def main() -> int:
    """Run the scenarios named on the command line."""
    args = _arguments()
    if args.list:
        for name, scenario in SCENARIOS.items():
            print(f"{name:14}{scenario.what}")
        return 0
    compile_gateway()
    _allow_many_descriptors()
    failures = 0
    with tempfile.TemporaryDirectory(prefix="bench.") as name:
        tools = Path(name)
        compile_into(tools)
        print("| scenario |", " | ".join(title for title, _ in COLUMNS), "| remarks |")
        print("|---|" + "---:|" * len(COLUMNS) + "---|")
        for title in args.scenarios or SCENARIOS:
            scenario = SCENARIOS[title]
            if args.seconds:
                scenario = replace(scenario, seconds=args.seconds)
            failures += not _show(title, scenario, tools, args.rounds)
    return 1 if failures else 0


def _show(title: str, scenario: Scenario, tools: Path, rounds: int) -> bool:
    """Measure and print one scenario; whether all answers were right."""
    kinds = ["gateway", "relay", *["direct"] * scenario.has_direct]
    runs: dict[str, list[Figures]] = {kind: [] for kind in kinds}
    try:
        for number in range(rounds):
            for kind in kinds if number % 2 else kinds[::-1]:
                runs[kind].append(run(scenario.for_relay if kind == "relay" else scenario, tools, kind))
    except BenchError as error:
        print(f"| {title} | {error} |")
        return False
    ours, relay = together(runs["gateway"]), together(runs["relay"])
    direct = together(runs["direct"]) if scenario.has_direct else None
    ours["cpu_ratio"] = ours["cpu"] / relay["cpu"]
    ours["of_relay"] = ours["rate"] / relay["rate"]
    cells = (make(ours, relay) for _, make in COLUMNS)
    print(f"| {title} |", " | ".join(cells), f"| {_remarks(scenario, ours, relay, direct)} |", flush=True)
    return not any(each[fault] for each in (ours, relay) for fault in FAULTS)


def _remarks(scenario: Scenario, ours: Figures, relay: Figures, direct: Figures | None) -> str:
    remarks = [
        f"{goal.figure} {ours[goal.figure]:.2f}, goal {goal}{'' if goal.is_met(ours[goal.figure]) else ': MISSED'}"
        for goal in scenario.goals
    ]
    remarks += [f"relay: {relay[fault]:.0f} {fault.replace('_', ' ')}" for fault in FAULTS if relay[fault]]
    if direct:
        added, least = ours["p50"] - direct["p50"], relay["p50"] - direct["p50"]
        remarks.append(f"{added:.2f} ms more than on the line itself (relay {least:.2f})")
    return "; ".join(remarks)


def _allow_many_descriptors() -> None:
    """A thousand connections for the programs that are started."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(max(soft, 8192), hard), hard))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], epilog="What the columns are: docs/performance.md"
    )
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="some of --list (default: all)")
    parser.add_argument("--rounds", type=int, default=3, help="how often each is measured")
    parser.add_argument("--seconds", type=float, help="how long each round takes, instead of the scenario's own")
    parser.add_argument("--list", action="store_true", help="show the scenarios")
    args = parser.parse_args()
    if unknown := set(args.scenarios) - set(SCENARIOS):
        parser.error(f"no such scenario: {', '.join(sorted(unknown))}; see --list")
    return args


if __name__ == "__main__":
    sys.exit(main())
