"""The lines that are gone through, and what may happen on each."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Final

from gateway.lines.settings import LineSettings
from gateway.timing.characters import CharacterFormat, LineTiming
from model.letters import LETTERS
from model.world import Setting

_TIMINGS: Final = {
    "rtu": LineTiming("rtu", 19200, CharacterFormat.parse("8E1")),
    "ascii": LineTiming("ascii", 9600, CharacterFormat.parse("7E1")),
}
_LINE: Final = LineSettings("line", _TIMINGS["rtu"], turnaround=0.1)
_PORTS: Final = ("direct", "direct with echo", "real", "real with echo", "real that echoes")

#: Letters that belong together, so that a search among them alone goes deeper.
ALPHABETS: Final[dict[str, tuple[str, ...]]] = {
    "everything": tuple(LETTERS),
    "late": (
        "read", "other read", "other write", "answer", "newest answer", "exception", "half an answer", "other half",
        "answer with wrong check sum", "silence", "limit", "window", "nearly the window", "oversleep",
    ),
    "damaged": (
        "read", "other read", "read from other unit", "answer", "answer with wrong check sum",
        "answer with wrong unit", "answer with parity error", "foreign read from other unit",
        "foreign answer with wrong check sum", "foreign answer with wrong unit", "noise", "silence", "limit", "window",
    ),
    "foreign": (
        "read", "other read", "write", "answer", "exception", "foreign read", "other foreign read", "foreign write",
        "foreign answer", "newest foreign answer", "foreign exception", "silence", "limit", "window",
    ),
    "switch": (
        "switch", "write", "answer", "exception", "copy of answer", "same foreign switch", "foreign answer",
        "foreign exception", "foreign write", "silence", "limit", "window",
    ),
    "coils": (
        "read coils", "read coils further on", "answer", "exception", "foreign read of coils",
        "other foreign read of coils", "foreign answer", "foreign exception", "silence", "limit", "window", "rest",
    ),
    "reload": (
        "read", "read from other unit", "read coils", "answer", "reload", "foreign read", "foreign read of coils",
        "other foreign read of coils", "foreign answer", "silence", "limit", "window",
    ),
    "together": (
        "read", "other read", "answer", "copy of answer", "foreign read", "other foreign read", "foreign answer",
        "noise", "next two together", "silence", "limit",
    ),
    "port": (
        "read", "write", "same read", "read, then other read", "broadcast", "order to listen only", "client leaves",
        "answer", "half an answer", "other half", "port lost", "port back", "finish", "silence", "limit", "window",
    ),
    "echo": (
        "read", "write", "other read", "answer", "copy of answer", "foreign read", "foreign answer", "echo",
        "echo lost", "echo damaged", "request has left", "silence", "limit",
    ),
    "moves": (
        "read", "read from other unit", "move", "move back", "other unit moves there", "other unit takes its place",
        "answer", "newest answer", "exception", "answer lost", "silence", "limit", "window", "reload",
    ),
    "bits": (
        "bits", "other bits", "write", "answer", "newest answer", "exception", "answer with wrong check sum",
        "foreign write", "client leaves", "port lost", "port back", "finish", "silence", "limit", "window",
    ),
    "rest": (
        "read", "other read", "read from other unit", "answer", "exception", "answer with wrong check sum", "noise",
        "silence", "limit", "window", "rest", "port lost", "port back",
    ),
    "wakes": (
        "read", "other read", "read from other unit", "write", "answer", "newest answer", "exception", "half an answer",
        "other half", "foreign read", "foreign answer", "noise", "silence", "limit", "window", "rest", "port lost",
        "port back", "reload",
    ),
    "wakes and moves": (
        "read", "move", "other unit takes its place", "answer", "newest answer", "exception", "answer lost", "silence",
        "limit", "window", "rest", "reload",
    ),
}  # fmt: skip

#: Devices that may sleep do so after so many seconds without a request: longer than a limit and a late window.
_WAKE: Final = 1.0
#: What has happened before: a unit has failed so often that it rests the next time; one is late that is to move; one
#: that may have slept was sent its read twice.
_BEFORE: Final = {
    "rest": ("read", "limit", "window") * 2,
    "moves": ("read", "limit", "move"),
    "wakes": ("read", "limit"),
    "wakes and moves": ("read", "limit"),
}


def setting(
    mode: str = "rtu", port: str = "direct", *, retries: int = 0, alphabet: str = "everything", **more: object
) -> Setting:
    """A line. Of its port the bytes come at once or are `real`, it is set to an `echo`, or `echoes` and is not."""
    line = replace(_LINE, timing=_TIMINGS[mode], echo=port.endswith("with echo"), retries=retries, **more)
    name = f"{mode}, {port}, {retries} retries, {alphabet}"
    before, wake = _BEFORE.get(alphabet, ()), _WAKE * ("wakes" in alphabet)
    return Setting(name, line, "real" in port, "echo" in port, ALPHABETS[alphabet], before, "moves" in alphabet, wake)


def settings(*alphabets: str) -> Iterator[Setting]:
    """All kinds of lines, with each of these alphabets; that of the echo where there is one."""
    for alphabet, mode, port, retries in product(alphabets, _TIMINGS, _PORTS, (0, 1)):
        if alphabet != "echo" or "echo" in port:
            yield setting(mode, port, retries=retries, alphabet=alphabet)
