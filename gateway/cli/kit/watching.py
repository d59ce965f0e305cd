"""What `-w` does: shows something again each second, until Ctrl-C."""

import shutil
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr
from io import StringIO
from typing import Final, TypeVar

from gateway.cli.kit.cells import cut, wrapped
from gateway.cli.kit.paint import dim, red
from gateway.cli.kit.terminal import drawable, takes_codes, write_codes
from gateway.errors import GatewayError

A = TypeVar("A")

#: How often it is looked again, in seconds.
EVERY: Final = 1.0
WATCH_HELP: Final = "show it again every second"


def repeat(tell: Callable[[], str], *, is_watched: bool) -> None:
    """Print text for programs, and again each second if it `is_watched`."""
    print(tell(), flush=True)
    while is_watched:
        time.sleep(EVERY)
        print(tell(), flush=True)


def watch(look: Callable[[], A], show: Callable[[A, int], str]) -> None:
    """Show what `look` returns, for a width in cells, again each second on the whole screen of a terminal.

    `look` may raise a GatewayError: the first time it is passed on, then it is shown, and tried again. Where there is
    no terminal, or it takes no codes, one text is printed after the other.
    """
    seen, at, trouble = look(), time.monotonic(), ""
    while not takes_codes(sys.stdout):
        print(show(seen, shutil.get_terminal_size().columns), end="\n\n", flush=True)
        time.sleep(EVERY)
        seen = look()
    write_codes(sys.stdout, "\x1b[2J")
    with redirect_stderr(StringIO()):  # what was said at the first look stays there
        while True:
            _draw(show(seen, shutil.get_terminal_size().columns), trouble, time.monotonic() - at)
            time.sleep(EVERY)
            try:
                seen, at, trouble = look(), time.monotonic(), ""
            except GatewayError as error:
                trouble = str(error)


def _draw(text: str, trouble: str, age: float) -> None:
    """Draw as many lines as there is room for, below what is wrong with the gateway."""
    columns, rows = shutil.get_terminal_size()
    told = f"{trouble}; it is tried again, and what is shown is {age:.0f} s old" if trouble else ""
    lines = [*map(red, wrapped(told, columns) if told else ()), *text.splitlines()]
    if len(lines) > rows:
        lines[rows - 1 :] = [dim(f"{len(lines) - rows + 1} more lines: a higher window, or without -w, shows them")]
    lines += [""] * (rows - len(lines))
    drawn = (drawable(sys.stdout, cut(line, columns)) for line in lines)
    write_codes(sys.stdout, "".join(f"\x1b[{row};1H\x1b[K{line}" for row, line in enumerate(drawn, 1)))
