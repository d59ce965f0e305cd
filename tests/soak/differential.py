"""Two versions of the gateway side by side: whatever is seen from outside must be the same, to the microsecond.

    .venv/bin/python tests/soak/differential.py ../before . --transactions 20000 --seeds 5
    .venv/bin/python tests/soak/differential.py ../before . --part lines --part late --part long --depth 2

For a change of the machinery that is to change no behaviour. Arguments are two checkouts. On both are played: all
worlds of `never_lies`, random long orders of the model, lines on which `anything` may happen, and every order of each
alphabet of the model; each in a process of its own, with the same seeds. `outward` has what is compared. Prints the
first difference of each run with what was before it. Ends with status 0 if there is none. The orders to each state are
found on the first checkout.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice, zip_longest
from pathlib import Path
from typing import IO, Final

OUTWARD: Final = Path(__file__).with_name("outward.py")
#: So many lines are shown before the first difference, and from there on.
BEFORE: Final = 30
BEHIND: Final = 4
#: The alphabet of all letters, which is searched less deep than the others.
EVERYTHING: Final = "everything"


def start(checkout: Path, tests: Path, *args: str, stdout: int | IO[str], stderr: IO[str]) -> subprocess.Popen[str]:
    """Play a part on a checkout, with the tests of one."""
    path = checkout, tests / "tests", OUTWARD.parent  # `anything` is the same one for both
    environment = os.environ | {"PYTHONPATH": ":".join(map(str, path)), "PYTHONHASHSEED": "0"}
    command = [sys.executable, "-P", str(OUTWARD), *args]
    return subprocess.Popen(command, env=environment, cwd=checkout, stdout=stdout, stderr=stderr, text=True)


def run(checkout: Path, *args: str) -> str:
    """Let a part be played to its end; what is written."""
    with tempfile.TemporaryFile("w+") as written:
        process = start(checkout, checkout, *args, stdout=written, stderr=sys.stderr)
        if process.wait():
            sys.exit(f"{' '.join(args)} failed on {checkout}")
        written.seek(0)
        return written.read()


class Versions:
    """The two checkouts, where the tests come from for each, and what is left out of each line."""

    def __init__(self, checkouts: Sequence[Path], tests: Path | None, ignored: str = "") -> None:
        self.checkouts = checkouts
        self._tests = tests
        self._ignored = re.compile(ignored) if ignored else None
        self.records = 0

    def differ(self, title: str, *args: str) -> bool:
        """Play this on both, and print what differs first."""
        begin = time.monotonic()
        with tempfile.TemporaryFile("w+") as one, tempfile.TemporaryFile("w+") as other:
            errors = (one, other)
            processes = [
                start(checkout, self._tests or checkout, *args, stdout=subprocess.PIPE, stderr=error)
                for checkout, error in zip(self.checkouts, errors, strict=True)
            ]
            count, difference = self._compare([process.stdout for process in processes if process.stdout])
            for process in processes:
                process.kill() if difference else process.wait()
            troubles = [_text_of(error) for error in errors]
            has_failed = any(process.wait() for process in processes) and not difference
        self.records += count
        verdict = "DIFFERENT" if difference else "FAILED" if has_failed else "alike"
        print(f"{title}: {count} records {verdict}, {time.monotonic() - begin:.1f} s", flush=True)
        print(*difference, *(text for text in troubles if text), sep="\n", end="\n" if difference else "")
        return bool(difference) or has_failed

    def _compare(self, streams: Sequence[IO[str]]) -> tuple[int, list[str]]:
        """How many lines are the same, and the first difference, if there is one, with what is around it."""
        last: deque[str] = deque(maxlen=BEFORE)
        count = 0
        kept = [self._kept(stream) for stream in streams]
        for pair in zip_longest(*kept):
            if pair[0] != pair[1]:
                around = ["    " + line.rstrip() for line in last]
                for name, line, stream in zip(("first", "second"), pair, kept, strict=True):
                    rest = [line or "(it has ended)\n", *islice(stream, BEHIND)]
                    around += [f"{name}:", *("    " + each.rstrip() for each in rest)]
                return count, around
            last.append(pair[0])
            count += 1
        return count, []

    def _kept(self, stream: IO[str]) -> Iterator[str]:
        """The lines without what is ignored; without a line that is ignored whole."""
        if self._ignored is None:
            return iter(stream)
        lines = (self._ignored.sub("", line) for line in stream)
        return (line for line in lines if line.strip())


def _text_of(file: IO[str]) -> str:
    file.seek(0)
    return file.read()


def main() -> int:
    """Compare all parts that were asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkouts", type=Path, nargs=2, help="the version before, and the one that is to be the same")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=1, help="so many, one behind the other")
    parser.add_argument("--transactions", type=int, default=5000, help="of each world and seed; of an order about ten")
    parser.add_argument("--faults", type=float, default=0.2, help="share of the transactions that meet one")
    parser.add_argument("--depth", type=int, default=3, help="of the orders; one less with all letters; 0: none")
    parser.add_argument("--part", action="append", help="a world, `long`, `anything`, or an alphabet; by default all")
    parser.add_argument("--deadlines", action="store_true", help="compare when each line is to be woken, too")
    parser.add_argument("--tests", type=Path, help="the checkout whose tests are used for both, not each its own")
    parser.add_argument("--ignore", default="", metavar="REGEX", help=r"a difference that is meant: `late_windows=\d+`")
    args = parser.parse_args()
    checkouts = [each.resolve() for each in args.checkouts]
    versions = Versions(checkouts, args.tests and args.tests.resolve(), args.ignore)
    begin, different = time.monotonic(), []
    worlds, alphabets = (line.split(",") for line in run(checkouts[0], "parts").splitlines())
    strict = ["--deadlines"] * args.deadlines
    parts = args.part or [*worlds, *alphabets]
    for seed in range(args.seed, args.seed + args.seeds):
        options = ["--seed", str(seed), "--transactions", str(args.transactions), "--faults", str(args.faults), *strict]
        different += [
            f"{part}, seed {seed}"
            for part in parts
            if part not in alphabets and versions.differ(f"{part}, seed {seed}", part, *options)
        ]
    for part in parts if args.depth else ():
        if part in alphabets:
            depth = args.depth - (part == EVERYTHING)
            with tempfile.NamedTemporaryFile("w", suffix=".orders") as orders:
                orders.write(run(checkouts[0], part, "--depth", str(depth)))
                orders.flush()
                if versions.differ(f"{part}, depth {depth}", part, "--orders", orders.name, *strict):
                    different.append(part)
    elapsed = time.monotonic() - begin
    print(f"{versions.records} records in {elapsed:.0f} s; different: {'; '.join(different) or 'none'}")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
