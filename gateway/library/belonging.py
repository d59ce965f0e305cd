"""Units of a program belong to one gateway at a time: they ask its units, and are asked one request after the other."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from gateway.images.custom_unit import FIND, CustomUnit


@contextmanager
def belonging(units: Mapping[int, CustomUnit], find: Callable[[int | str], Any]) -> Iterator[None]:
    """Let `units` belong to the gateway whose units `find` finds, inside the context.

    A call that does not heed that it is cancelled may go on after it, beside those of the next gateway.

    Raises:
        RuntimeError: one of them belongs to another gateway, which runs.
    """
    taken: list[CustomUnit] = []
    try:
        for number, unit in units.items():
            # in one step: the other gateway may be started in another thread
            if vars(unit).setdefault(FIND, find) != find:
                raise RuntimeError(f"units[{number}] belongs to another gateway that runs: make one for each")
            taken.append(unit)
        yield
    finally:
        for unit in taken:
            vars(unit).pop(FIND, None)
