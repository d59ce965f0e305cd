"""What commands print: registers and peers may say anything, but a terminal gets no control characters of theirs."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from typing import Any, Final, TextIO, cast

from gateway.observe.printable import printable

#: Sequences: go to the upper left; clear to the end of the line; clear below.
_HOME: Final = "\x1b[H"
_CLEAR_LINE: Final = "\x1b[K"
_CLEAR_BELOW: Final = "\x1b[J"


class _Escaping:
    """A stream whose text has escapes in place of control characters; `inner` has the stream itself.

    So it has in place of what the terminal's encoding lacks: a name may be in any script.
    """

    def __init__(self, inner: TextIO) -> None:
        self.inner = inner

    def write(self, text: str) -> int:
        """Write the text."""
        shown = printable(text)
        try:
            return self.inner.write(shown)
        except UnicodeEncodeError:
            encoding = self.inner.encoding
            return self.inner.write(shown.encode(encoding, "backslashreplace").decode(encoding))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@contextmanager
def no_control_characters() -> Iterator[None]:
    """Escape control characters in what is printed inside the context; `unescaped` is for our own."""
    with ExitStack() as stack:
        if sys.stdout is not None:
            stack.enter_context(redirect_stdout(cast("TextIO", _Escaping(sys.stdout))))
        if sys.stderr is not None:
            stack.enter_context(redirect_stderr(cast("TextIO", _Escaping(sys.stderr))))
        yield


def unescaped(stream: TextIO) -> TextIO:
    """Return the stream for text of ours that moves the cursor."""
    return stream.inner if isinstance(stream, _Escaping) else stream


def redrawn(text: str, rows: int) -> str:
    """Add the sequences that draw `text` over the present content of a terminal with this many rows."""
    lines = printable(text).splitlines()
    if len(lines) >= rows:
        lines = [*lines[: rows - 2], f"{len(lines) - rows + 2} more lines: make the window higher"]
    return _HOME + "".join(f"{line}{_CLEAR_LINE}\n" for line in lines) + _CLEAR_BELOW
