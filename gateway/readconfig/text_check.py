"""Checks a text that is no file yet, in a process of its own.

Nothing that the text names is opened, looked for or imported, and nothing that it says can delay the gateway: the
process has a limit of time and of memory, and gives way to others.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.config.machine.file_text import find_wrong_text, plain_text
from gateway.config.problem import Severity
from gateway.readconfig.process import READING_TIME, Reading

#: How long checking a text may take, in seconds: as long as reading the config.
CHECKING_TIME: Final = READING_TIME


@dataclass(frozen=True, slots=True)
class TextProblem:
    """A problem of a text: its place, what is wrong, and `help`, which says what to write instead.

    `line` and `column` count from 1, and are 0 for the text as a whole. `file` is that of an own profile, if the place
    is there; `line` and `column` then count in that file. `path` is such as `line[0].baud`.
    """

    severity: Severity
    line: int
    column: int
    path: str
    message: str
    help: str = ""
    file: str = ""


@dataclass(frozen=True, slots=True)
class TextChanges:
    """The tables that would change; those in `restart` only after a restart."""

    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    restart: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class TextCheck:
    """What `check` says of a text, and what would change if it were the config.

    `changes` is None if the text has errors. `difference` has the lines that differ, without comments and secrets.
    `notes` say what was not looked at.
    """

    problems: tuple[TextProblem, ...]
    changes: TextChanges | None = None
    difference: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def has_errors(self) -> bool:
        """Whether the text cannot be used."""
        return any(each.severity == "error" for each in self.problems)


def check_text(file: Path, text: str, in_use: str) -> TextCheck:
    """Check `text` as the content of `file`, and compare it with the text `in_use`. Blocks for CHECKING_TIME at most.

    Raises:
        ConfigError: the process cannot be started, fails, or takes too long; the message says which.
    """
    text = plain_text(text)
    if wrong := find_wrong_text(text):
        return TextCheck((TextProblem("error", 0, 0, "", wrong),))
    process = Reading("the text", [str(file), "text"], packed_texts(text, in_use))
    checked: TextCheck = process.result(CHECKING_TIME)
    return checked


def packed_texts(text: str, in_use: str) -> bytes:
    """Write both texts for the process; JSON of them would take the interpreter from the lines for longer."""
    content = text.encode()
    return b"%d\n%b%b" % (len(content), content, in_use.encode())


def unpacked_texts(given: bytes) -> tuple[str, str]:
    """Read what `packed_texts` has written."""
    size, _, both = given.partition(b"\n")
    return both[: int(size)].decode(), both[int(size) :].decode()
