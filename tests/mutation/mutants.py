"""Mutation testing of the request path: small faults in its code, one at a time, each of which the tests have to see.

    .venv/bin/pip install cosmic-ray
    .venv/bin/python tests/mutation/mutants.py --sample 300 --quick --jobs 2
    .venv/bin/python tests/mutation/mutants.py gateway/lines/ledger.py --jobs 2
    .venv/bin/python tests/mutation/mutants.py gateway/lines --sample 300 --only tests/stories/lines

Without `--sample` every mutant runs, which takes hours. The tests of a mutant are those of its module, then those of
its package; with `--only` others, and what is known by these is kept apart. What is known is kept in `.mutation`, in
one session of cosmic-ray for each module (`cr-html` shows it), until that module changes: a run that was stopped goes
on, and `--again` runs only what has survived so far. Mutants that no test can tell from the code as it is stand in
`equivalent.toml` with the reason, and are left out. One that takes ten minutes on the clock is undecided, as the
machine may be busy; a test that takes far more processor time than without it has failed. Ends with status 0 if enough
of the others are killed.
"""

import argparse
import hashlib
import math
import os
import random
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]

try:
    from mutation.running import TESTS, Runner, survey
    from mutation.sessions import ROOT, SESSIONS, Module, Mutant, TestOutcome, open_module
except ImportError:
    sys.exit("cosmic-ray is not installed; .venv/bin/pip install cosmic-ray")

PACKAGES: Final = ("gateway/lines", "gateway/modbus", "gateway/routing", "gateway/timing")
EQUIVALENT: Final = Path(__file__).with_name("equivalent.toml")
#: The share that must be killed.
ENOUGH: Final = 0.90
#: Seconds of the tests that `--quick` leaves out.
SLOW: Final = 0.1


def open_modules(paths: Sequence[str], sessions: Path) -> list[Module]:
    """All modules in these files and folders that have mutants."""
    equivalent = tomllib.loads(EQUIVALENT.read_text())
    files = [file for path in map(Path, paths) for file in (sorted(path.glob("*.py")) if path.is_dir() else [path])]
    modules = [open_module(file.resolve(), equivalent.get(file.as_posix(), {}), sessions) for file in files]
    return [module for module in modules if module.mutants]


def choose(modules: Sequence[Module], sample: int | None, seed: int) -> list[Mutant]:
    """The mutants that are asked for: the same ones for the same seed and code."""
    everything = [mutant for module in modules for mutant in module.mutants]
    if sample is None or sample >= len(everything):
        return everything
    return random.Random(seed).sample(everything, sample)


def pending(modules: Sequence[Module], chosen: Sequence[Mutant], *, again: bool) -> list[Mutant]:
    """Those of which nothing is known, or, `again`, those that have survived."""
    known = {job: result.test_outcome for module in modules for job, result in module.database.results}
    wanted = TestOutcome.SURVIVED if again else None
    return [mutant for mutant in chosen if known.get(mutant.item.job_id) == wanted]


def report(modules: Sequence[Module], chosen: Sequence[Mutant]) -> bool:
    """Print what has survived, and a line for each module. Whether enough was killed."""
    rows, killed_of_all, run_of_all = [], 0, 0
    for module in modules:
        outcomes = {job: result.test_outcome for job, result in module.database.results}
        run = [mutant for mutant in chosen if mutant.module is module and mutant.item.job_id in outcomes]
        survived = [mutant for mutant in run if outcomes[mutant.item.job_id] == TestOutcome.SURVIVED]
        for mutant in sorted(survived, key=lambda mutant: mutant.place):
            print(f"{module.name}:{mutant.mutation.start_pos[0]} {mutant.operator}\n    {mutant.change}")
        killed = len(run) - len(survived)
        rows.append(_row(module.name, len(module.mutants), module.equivalents, len(run), killed))
        killed_of_all += killed
        run_of_all += len(run)
    print(f"{'':32} mutants  equivalent   run  killed")
    print("\n".join(rows))
    mutants, equivalents = sum(len(each.mutants) for each in modules), sum(each.equivalents for each in modules)
    print(_row("all", mutants, equivalents, run_of_all, killed_of_all))
    if 0 < run_of_all < mutants:
        share = killed_of_all / run_of_all
        print(f"of all mutants, {share:.1%} +- {1.96 * math.sqrt(share * (1 - share) / run_of_all):.1%} are killed")
    return killed_of_all >= ENOUGH * run_of_all


def _row(name: str, mutants: int, equivalents: int, run: int, killed: int) -> str:
    share = f"{killed / run:6.1%}" if run else ""
    return f"{name:32} {mutants:7} {equivalents:11} {run:5} {killed:7} {share}"


def _version(tests: Sequence[str]) -> str:
    """Of all code and tests together."""
    folders = [Path(each) for each in ("gateway", *tests, "tests/kit")]
    found = (each for folder in folders for each in ([folder] if folder.is_file() else folder.rglob("*.*")))
    files = sorted(each for each in found if each.suffix in {".py", ".conversations"})
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("module", nargs="*", default=PACKAGES, help="files or folders; by default all of them")
    parser.add_argument("--sample", type=int, help="so many mutants, drawn at random")
    parser.add_argument("--seed", type=int, default=1, help="of the sample")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--again", action="store_true", help="run again what has survived so far")
    parser.add_argument("--quick", action="store_true", help=f"leave out tests that take more than {SLOW} s")
    parser.add_argument("--only", nargs="+", metavar="TESTS", default=(), help="run these files or folders of tests")
    args = parser.parse_args()
    os.chdir(ROOT)
    sessions = SESSIONS / hashlib.sha256(" ".join(args.only).encode()).hexdigest()[:12] if args.only else SESSIONS
    modules = open_modules(args.module, sessions)
    tests = args.only or TESTS
    seen = survey(sessions / f"tests-{_version(tests)}.json", tests)
    if seen is None:
        print(f"the tests fail without any mutant: pytest {' '.join(tests)}")
        return 1
    chosen = choose(modules, args.sample, args.seed)
    runner = Runner(seen, args.jobs, SLOW if args.quick else math.inf, args.only)
    runner.run(pending(modules, chosen, again=args.again))
    return 0 if report(modules, chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
