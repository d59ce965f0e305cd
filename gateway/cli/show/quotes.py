"""Problems of a config with the line that is wrong, and a caret below the place in it."""

from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.cli.kit.cells import cut, width_of
from gateway.cli.kit.paint import dim, red, yellow
from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.problem import Problem
from gateway.config.reading.excerpt import Excerpts
from gateway.config.reading.positions import Positions
from gateway.observe.printable import printable

#: At least this many cells of a line are shown, and so many of them stand before the caret, in thirds.
_LEAST: Final = 40
_BEFORE: Final = 2
_TAB: Final = "    "


class Quotes:
    """The lines of a config `file` with this text, and of other files that problems are in; `width` cells wide.

    `positions` are those in the text, if it is known to be TOML.
    """

    def __init__(self, file: str, text: str, width: int, positions: Positions | None = None) -> None:
        self._files = {file: Excerpts(text, positions)}
        self._width = width

    def told(self, problem: Problem) -> str:
        """Say what is wrong, and between that and the help show the line, if there is one without secrets."""
        paint = red if problem.severity == "error" else yellow
        first = str(replace(problem, remedy=""))
        remedy = str(problem).removeprefix(first)
        line = self._excerpts(problem.file).line(problem.line) or ""
        quoted = self._quoted(problem, line) if line.strip() and not _is_about_all(problem, line) else ""
        severity = f": {problem.severity}: "
        return first.replace(severity, severity.replace(problem.severity, paint(problem.severity)), 1) + quoted + remedy

    def _excerpts(self, file: str) -> Excerpts:
        if file not in self._files:
            try:
                self._files[file] = Excerpts(read_file_text(Path(file)))
            except UnreadableFile:
                self._files[file] = Excerpts("")
        return self._files[file]

    def _quoted(self, problem: Problem, line: str) -> str:
        paint = red if problem.severity == "error" else yellow
        number = f"{problem.line:5} | "
        room = max(_LEAST, self._width - len(number) - 1)
        shown, at = _window(_shown(line), width_of(_shown(line[: problem.column - 1])), room)
        edge = " " * (len(number) - 2) + "| "
        return f"\n{dim(number)}{shown}\n{dim(edge)}{' ' * at}{paint('^')}"


def _is_about_all(problem: Problem, line: str) -> bool:
    """Tell whether a problem is at the begin of the file because it has no place in it."""
    is_there = bool(problem.path) and str(problem.path[0]) in line
    return (problem.line, problem.column) == (1, 1) and not is_there


def _shown(text: str) -> str:
    return printable(text.replace("\t", _TAB))


def _window(line: str, at: int, room: int) -> tuple[str, int]:
    """Cut a long line around the cell `at`; return what is left, and where that cell is in it."""
    line = line.rstrip()
    width = width_of(line)
    if width <= room:
        return line, at
    start = max(0, min(at - room * _BEFORE // 3, width - room))
    left, right = "…" if start else "", "…" if start + room < width else ""
    shown = left + cut(line, room - len(left) - len(right), start + len(left)) + right
    return shown, at - start
