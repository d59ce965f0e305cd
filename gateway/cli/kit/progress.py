"""How far a long command is: one line on a terminal that is written again and again."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic
from typing import Final

from gateway.cli.kit.cells import cut, padded, width_of
from gateway.cli.kit.terminal import drawable, write_codes

#: It is written at most once in so many seconds, and has so many cells.
_EVERY: Final = 0.1
_WIDEST: Final = 78
#: Who waits for something of unknown length is told so after this many seconds, and after as many again.
_PATIENCE: Final = 1.0


class Progress:
    """The line; there is none where standard error is no terminal."""

    def __init__(self) -> None:
        self._is_shown = sys.stderr is not None and sys.stderr.isatty()
        self._width = 0
        self._next = 0.0

    def show(self, text: str) -> None:
        """Write this in place of what is there."""
        if not self._is_shown or monotonic() < self._next:
            return
        self._next = monotonic() + _EVERY
        text = cut(drawable(sys.stderr, text), _WIDEST)
        write_codes(sys.stderr, "\r" + padded(text, self._width))
        self._width = width_of(text)

    def clear(self) -> None:
        """Take the line away."""
        if self._width:
            write_codes(sys.stderr, "\r" + " " * self._width + "\r")
            self._width = 0


@contextmanager
def working(what: str) -> Iterator[None]:
    """Show `what` is being done and for how long, where the work in the context takes longer than a second."""
    ended = Event()

    def tell() -> None:
        with progress() as line:
            began = monotonic()
            while not ended.wait(_PATIENCE):
                line.show(f"{what} ... {monotonic() - began:.0f} s")

    teller = Thread(target=tell, daemon=True, name="progress")
    teller.start()
    try:
        yield
    finally:
        ended.set()
        teller.join()


@contextmanager
def progress() -> Iterator[Progress]:
    """Provide a line that is taken away at the end of the context."""
    line = Progress()
    try:
        yield line
    finally:
        line.clear()
