"""A client never receives data that is not the answer to its own request: long runs in worlds full of faults.

    .venv/bin/python tests/soak/never_lies.py --transactions 1000000 --faults 20% --seed 1 --jobs 2
    .venv/bin/python tests/soak/never_lies.py --world lines --transactions 1000000

A whole gateway in virtual time, in each of the worlds in turn. The transactions are shared out among them; every answer
is compared with what can be true at that moment. Ends with status 0 if no answer was wrong and every request was
answered exactly once. The same seed gives the same run.
"""

import argparse
import asyncio
import sys
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from kit.virtual_time import VirtualTimeLoop
from soak.tally import Tally
from soak.worlds import (
    bits,
    lines,
    maps,
    mirrors,
    monitors,
    moving,
    over_tcp,
    programs,
    reloads,
    rights,
    upstreams,
    writers,
)

#: Plays one run of so many transactions, this share of them with a fault, from a seed; in virtual time.
World = Callable[[int, float, int], Awaitable[Tally]]
WORLDS: Final[dict[str, World]] = {
    "bits": bits.play,
    "lines": lines.play,
    "maps": maps.play,
    "mirrors": mirrors.play,
    "monitors": monitors.play,
    "moving": moving.play,
    "over_tcp": over_tcp.play,
    "programs": programs.play,
    "reloads": reloads.play,
    "rights": rights.play,
    "upstreams": upstreams.play,
    "writers": writers.play,
}

LEFT_OUT: Final = """\
Left out, because nobody can detect it:
  - a response of the same shape that comes later than the late window
  - a duplicate that falls inside the next transaction of the same shape, of ours or of another client
  - the answer to another client whose request was not heard whole
  - pieces of two messages whose check sum fits
  - a device server that stalls after something was heard since a request, or answers a new connection for the old one
  - a gateway that stands still between its last look at a connection over TCP and the sending
  - a response of another Modbus TCP server with the identifier of another request that it fits too
  - a second response with identifier 0 while the next request, which it fits too, is under way or on its way
and damage that the check sum itself cannot show (random damage: 1 in 65536 on RTU, 1 in 256 on ASCII)"""


def run(world: str, transactions: int, share: float, seed: int) -> Tally:
    """Play one run, in a loop of its own."""

    async def play() -> Tally:
        return await WORLDS[world](transactions, share, seed)

    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(play())


def main() -> int:
    """Run all worlds that were asked for, and print what came of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--transactions", type=int, default=1_000_000, help="of all worlds and jobs together")
    parser.add_argument("--faults", default="20%", help="share of the transactions that meet one")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes; each has a seed of its own")
    parser.add_argument("--world", action="append", choices=WORLDS, help="by default all")
    args = parser.parse_args()
    share = float(args.faults.removesuffix("%")) / 100
    worlds = args.world or list(WORLDS)
    seeds = [args.seed * 1000 + job for job in range(args.jobs)]
    transactions = args.transactions // len(worlds) // args.jobs
    wrong = 0
    with ProcessPoolExecutor(args.jobs) as pool:
        runs = {name: [pool.submit(run, name, transactions, share, seed) for seed in seeds] for name in worlds}
        for name, parts in runs.items():
            tally, begin = Tally(), time.monotonic()
            for part in parts:
                tally.add(part.result())
            wrong += tally.wrong_count
            print(f"--- {name}", *tally.wrong[:20], tally, sep="\n")
            print(f"{time.monotonic() - begin:.0f} s with {args.jobs} processes", flush=True)
    print(LEFT_OUT)
    print(f"wrong or lost in all worlds: {wrong}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
