"""Keeps pauses by Python's garbage collector short: nothing is answered while it runs."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

#: So many objects that are not freed may come without a collection.
_MOST: Final = 200_000
#: How many answers are being made, and whether garbage is collected after them: a program around the gateway decides
#: that, unless it settles.
_in_progress = 0
_was_enabled = True


@contextmanager
def no_collection() -> Iterator[None]:
    """Collect no garbage inside the context: for a long answer, which is freed at the end, and would be traversed.

    What others leave meanwhile is bounded: if the last collection was too many objects ago, there will be one.
    """
    global _in_progress, _was_enabled  # noqa: PLW0603 - the collector is one for the process, too
    if not _in_progress:
        _was_enabled = gc.isenabled()
    _in_progress += 1
    try:
        if gc.get_count()[0] < _MOST:
            gc.disable()
        elif _was_enabled:
            gc.enable()
        yield
    finally:
        _in_progress -= 1
        if _was_enabled and not _in_progress:
            gc.enable()


def pass_over_present() -> None:
    """Exclude all present objects from later collections: modules, before the parts of the gateway are made.

    They stay, and are most of what a full collection would traverse: three quarters with 64 lines. The parts are not
    excluded, so that the old ones are freed after a reload.
    """
    gc.collect()
    gc.freeze()


def settle() -> None:
    """Free the parts that a start or a reload has left. A command that collects nothing while it starts does so now."""
    global _was_enabled  # noqa: PLW0603 - see above
    _was_enabled = True
    gc.enable()
    gc.collect()
