"""Random orders of what may happen to a line, longer than `every_order` reaches, in virtual time.

    .venv/bin/python tests/model/long_orders.py --seconds 60
    .venv/bin/python tests/model/long_orders.py --seconds 60 --alphabet coils --alphabet reload --seed 3

Lines, happenings and rules are those of `every_order`. Prints the story of each order in which something went wrong,
without the happenings that do not matter. Ends with status 0 if nothing did.
"""

import argparse
import random
import sys
import time
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from model.letters import do, drain, enabled
from model.search import Path as Order
from model.search import Search, replay
from model.settings import ALPHABETS, settings
from model.world import Setting, World

#: So many things happen in one order.
LENGTHS = range(4, 15)


def walk(setting: Setting, dice: random.Random) -> Search:
    """One order; if something goes wrong in it, the part of it that this takes."""
    world, order = replay(setting), []
    for _ in range(dice.choice(LENGTHS)):
        order.append(dice.choice(enabled(world)))
        do(world, order[-1])
        if world.wrong:
            break
    else:
        drain(world)
    return _shortened(setting, tuple(order), world) if world.wrong else Search(setting, len(order))


def _shortened(setting: Setting, order: Order, world: World) -> Search:
    at = 0
    while at < len(order):
        shorter = order[:at] + order[at + 1 :]
        other = _played(setting, shorter)
        if other is not None and _kind(other) == _kind(world):
            order, world = shorter, other
        else:
            at += 1
    return Search(setting, len(order), path=order, story=world.story, wrong=world.wrong)


def _played(setting: Setting, order: Order) -> World | None:
    """The world behind this order, if all of it can happen and something goes wrong."""
    world = replay(setting)
    for name in order:
        if name not in enabled(world):
            return None
        do(world, name)
    if not world.wrong:
        drain(world)
    return world if world.wrong else None


def _kind(world: World) -> str:
    return world.wrong[0].rpartition(": ")[2]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--alphabet", action="append", choices=ALPHABETS, help="what may happen; by default all in turn"
    )
    args = parser.parse_args()
    dice, lines = random.Random(args.seed), list(settings(*(args.alphabet or ALPHABETS)))
    orders, wrong, end = 0, 0, time.monotonic() + args.seconds
    while time.monotonic() < end:
        found = walk(dice.choice(lines), dice)
        orders += 1
        if found.wrong:
            wrong += 1
            print(found, flush=True)
    print(f"{orders} orders, {wrong} with something wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
