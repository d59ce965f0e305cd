"""Every order of what may happen to a line, up to a depth, in virtual time: nothing may go wrong.

    .venv/bin/python tests/model/every_order.py --depth 4 --jobs 2
    .venv/bin/python tests/model/every_order.py --depth 6 --jobs 2 --alphabet late --alphabet foreign

All kinds of lines: RTU and ASCII, real and direct wire, with and without echo and retries. What may happen is in
`letters`, what is left out in `wire`, what is wrong in `world`. Prints how many states each line has, and the story of
what went wrong, which is a shortest one. Ends with status 0 if nothing did.
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from model.search import search
from model.settings import ALPHABETS, settings


def _search(alphabets: list[str], depth: int, number: int) -> tuple[str, int, int, bool]:
    """What was found on one line, in words, its states and happenings, and whether something is wrong.

    By number and in plain values: what was compiled cannot be sent to another process.
    """
    found = search(list(settings(*alphabets))[number], depth=depth)
    return str(found), found.states, found.happenings, bool(found.wrong)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--depth", type=int, default=4, help="so many happenings, one behind the other")
    parser.add_argument("--alphabet", action="append", choices=ALPHABETS, help="what may happen; by default everything")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    alphabets = args.alphabet or ["everything"]
    begin, states, happenings, wrong = time.monotonic(), 0, 0, 0
    with ProcessPoolExecutor(args.jobs) as pool:
        lines = range(len(list(settings(*alphabets))))
        for story, more_states, more_happenings, is_wrong in pool.map(partial(_search, alphabets, args.depth), lines):
            print(story, flush=True)
            states += more_states
            happenings += more_happenings
            wrong += is_wrong
    elapsed = time.monotonic() - begin
    print(f"{states} states, {happenings} happenings, {wrong} lines with something wrong, {elapsed:.0f} s")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
