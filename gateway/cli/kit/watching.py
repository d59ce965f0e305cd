"""What `-w` does: shows something again and again, on the whole screen of a terminal; with keys to move in it."""

import shutil
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass
from io import StringIO
from threading import Event, Thread
from typing import Final, Generic, TypeVar

from gateway.cli.kit.cells import cut, padded, width_of, wrapped
from gateway.cli.kit.keyboard import Keyboard, whole_screen
from gateway.cli.kit.paint import dim, red, reverse
from gateway.cli.kit.terminal import drawable, takes_codes, write_codes
from gateway.errors import GatewayError

A = TypeVar("A")

#: How often it is looked again, in seconds.
EVERY: Final = 1.0
WATCH_HELP: Final = "show it again every second, on the whole screen of a terminal; ? there explains the keys"
#: At least this share of the rows is for what can be scrolled; else what is wrong is scrolled with it.
_SCROLLED: Final = 1 / 3

HELP: Final = """\
up, down, j, k              a row
page up, page down, space   a page
home, end, g, G             the begin, the end
left, right, h, l           to the side, where rows are longer than the screen
enter                       list the parts, and choose one to see only that
1 ... 9                     see only the part with this number
escape                      back
q, Ctrl-C                   end"""
#: So many cells the arrows to the left and to the right move by.
_SIDEWAYS: Final = 8


@dataclass(frozen=True)
class Screen:
    """What is shown. What is `wrong` stays above the `lines` while these are scrolled; none of it is too long.

    Each of the `parts` can be chosen by its name, to see only that one.
    """

    lines: Sequence[str]
    wrong: Sequence[str] = ()
    parts: Sequence[str] = ()


def repeat(tell: Callable[[], str], *, is_watched: bool) -> None:
    """Print text for programs, and again each second if it `is_watched`."""
    print(tell(), flush=True)
    while is_watched:
        time.sleep(EVERY)
        print(tell(), flush=True)


def watch(look: Callable[[], A], show: Callable[[A, int, str], Screen]) -> None:
    """Show what `look` returns, again each second, until the user ends it.

    `look` may raise a GatewayError: the first time it is passed on, then it is shown, and tried again. `show` makes
    the screen from what was seen, for a width in cells and the chosen part, or all of it if that is empty. Where there
    is no terminal, or it takes no codes, screens are printed one after the other.
    """
    seen = look()
    if not takes_codes(sys.stdout):
        while True:
            screen = show(seen, shutil.get_terminal_size().columns, "")
            print("\n".join([*screen.wrong, *screen.lines]), end="\n\n", flush=True)
            time.sleep(EVERY)
            seen = look()
    with redirect_stderr(StringIO()), whole_screen() as keyboard:  # what was said at the first look stays below
        looking = _Looking(look, seen, keyboard)
        try:
            _Watch(looking, show, keyboard).run()
        finally:
            looking.end()


class _Looking(Generic[A]):
    """Looks in a thread: a gateway that does not answer keeps no key waiting."""

    def __init__(self, look: Callable[[], A], seen: A, keyboard: Keyboard) -> None:
        self.seen = seen
        self.trouble = ""
        self.since = time.monotonic()
        self.defect: Exception | None = None
        self._look = look
        self._keyboard = keyboard
        self._ended = Event()
        Thread(target=self._run, daemon=True, name="looking").start()

    def end(self) -> None:
        """Look no more."""
        self._ended.set()

    def _run(self) -> None:
        while not self._ended.wait(EVERY):
            try:
                self.seen, self.trouble, self.since = self._look(), "", time.monotonic()
            except GatewayError as error:
                self.trouble = str(error)
            except Exception as error:  # noqa: BLE001 - it is raised where it is seen
                self.defect = error
                self.end()
            self._keyboard.wake()


class _Watch(Generic[A]):
    """The screen, and what of it the user has chosen."""

    def __init__(self, looking: _Looking[A], show: Callable[[A, int, str], Screen], keyboard: Keyboard) -> None:
        self._looking = looking
        self._show = show
        self._keyboard = keyboard
        self._scrolling = Scrolling()
        self._part = ""
        self._page = "all"
        self._cursor = 0
        self._screen = Screen(())
        self._made_of: tuple[A, int, str] | None = None
        self._drawn: list[str] = []
        self._size = (0, 0)

    def run(self) -> None:
        """Draw and obey keys until one of them ends it."""
        while self._looking.defect is None:
            self._draw(*shutil.get_terminal_size())
            for key in self._keyboard.wait():
                if key == "q":
                    return
                self._obey(key)
        raise self._looking.defect

    def _obey(self, key: str) -> None:
        if key == "?":
            self._go_to("help")
        elif key == "escape":
            self._part = self._part if self._page != "all" else ""
            self._go_to("all")
        elif key.isdecimal() and key != "0":
            self._choose(int(key) - 1)
        elif self._page == "parts":
            self._obey_in_list(key)
        elif key == "enter" and self._screen.parts:
            self._go_to("parts")
        else:
            self._scrolling.obey(key)

    def _obey_in_list(self, key: str) -> None:
        last = len(self._screen.parts) - 1
        if key == "enter":
            self._choose(self._cursor)
        else:
            steps = {"up": -1, "k": -1, "down": 1, "j": 1, "home": -last, "g": -last, "end": last, "G": last}
            self._cursor = max(0, min(last, self._cursor + steps.get(key, 0)))

    def _choose(self, number: int) -> None:
        if number < len(self._screen.parts):
            self._part, self._cursor = self._screen.parts[number], number
            self._go_to("all")

    def _go_to(self, page: str) -> None:
        self._page, self._scrolling = page, Scrolling()

    def _draw(self, columns: int, rows: int) -> None:
        self._make(columns)
        trouble, wrong, body = self._trouble(columns), self._screen.wrong, self._body()
        pinned = [*trouble, *([""] if trouble and wrong else []), *wrong]
        if pinned and body:
            pinned.append("")
        if len(pinned) + 1 + max(1, rows * _SCROLLED) > rows:  # what was asked for by a key is seen first
            is_asked = bool(self._part) or self._page != "all"
            pinned, body = [], [*body, "", *pinned] if is_asked else [*pinned, *body]
        to_see = self._cursor if self._page == "parts" else None
        shown = self._scrolling.shown(body, columns, max(1, rows - len(pinned) - 1), to_see)
        lines = [*pinned, *shown]
        lines += [""] * (rows - 1 - len(lines))
        self._put([*lines[: rows - 1], self._footer(columns)], (columns, rows))

    def _make(self, columns: int) -> None:
        """Make the screen, unless it is the same as before."""
        made_of = (self._looking.seen, columns, self._part)
        if self._made_of is None or made_of[0] is not self._made_of[0] or made_of[1:] != self._made_of[1:]:
            self._screen, self._made_of = self._show(*made_of), made_of
            if self._part and self._part not in self._screen.parts:  # it is no longer there
                self._part = ""
                self._make(columns)

    def _trouble(self, columns: int) -> list[str]:
        if not self._looking.trouble:
            return []
        ago = time.monotonic() - self._looking.since
        text = f"{self._looking.trouble}; it is tried again, and what is shown is {ago:.0f} s old"
        return [red(line) for line in wrapped(text, columns)]

    def _body(self) -> Sequence[str]:
        if self._page == "help":
            return HELP.splitlines()
        if self._page == "parts":
            rows = [f"{number:3}  {part} " for number, part in enumerate(self._screen.parts, 1)]
            return [reverse(row) if at == self._cursor else row for at, row in enumerate(rows)]
        return self._screen.lines

    def _footer(self, columns: int) -> str:
        where = f"only {self._part}" if self._part and self._page == "all" else ""
        back = "escape back" if where or self._page != "all" else ""
        choose = "enter choose" if self._screen.parts and self._page != "help" else ""
        facts = (where, self._scrolling.place, choose, back, "? help", "q end")
        return dim(padded(cut("  ".join(filter(None, facts)), columns), columns))

    def _put(self, lines: Sequence[str], size: tuple[int, int]) -> None:
        """Write the rows that have changed."""
        codes = ""
        if size != self._size:
            self._size, self._drawn, codes = size, [""] * len(lines), "\x1b[2J"
        before, self._drawn = self._drawn, [drawable(sys.stdout, line.replace("\n", " ")) for line in lines]
        for row, (old, new) in enumerate(zip(before, self._drawn, strict=True), 1):
            codes += f"\x1b[{row};1H\x1b[K{new}" if old != new else ""
        write_codes(sys.stdout, codes)


class Scrolling:
    """Where in a text the screen is; `place` says it, and is empty if all of it is seen."""

    def __init__(self) -> None:
        self.place = ""
        self._top = self._side = 0
        self._page = 1

    def obey(self, key: str) -> None:
        """Move as a key says; keys of another meaning do nothing."""
        rows = {"up": -1, "k": -1, "down": 1, "j": 1, "page up": -self._page, "page down": self._page}
        rows |= {"home": -sys.maxsize, "g": -sys.maxsize, "end": sys.maxsize, "G": sys.maxsize}
        cells = {"left": -_SIDEWAYS, "h": -_SIDEWAYS, "right": _SIDEWAYS, "l": _SIDEWAYS}
        self._top += rows.get(key, 0)
        self._side += cells.get(key, -sys.maxsize if key in ("home", "g") else 0)

    def shown(self, text: Sequence[str], columns: int, rows: int, to_see: int | None = None) -> Sequence[str]:
        """Return what is seen of a text in so many columns and rows, among it the row that is `to_see`."""
        self._page = max(1, rows - 1)
        if to_see is not None:
            self._top = max(to_see - rows + 1, min(self._top, to_see))
        self._top = max(0, min(self._top, len(text) - rows))
        longest = max(map(width_of, text), default=0)
        self._side = max(0, min(self._side, longest - columns + 1)) if longest > columns else 0
        seen = text[self._top : self._top + rows]
        self.place = f"{self._top + 1}-{self._top + len(seen)} of {len(text)}" if len(text) > rows else ""
        return [_clipped(line, columns, self._side) for line in seen]


def _clipped(line: str, columns: int, side: int) -> str:
    """Cut out what fits, with a mark at each side where there is more."""
    width = width_of(line)
    left = dim("<") if side and width else ""
    right = dim(">") if width - side > columns else ""
    return left + cut(line, columns - bool(left) - bool(right), side + bool(left)) + right
