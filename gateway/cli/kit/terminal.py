"""What commands print: registers and peers may say anything, but a terminal gets no control characters of theirs."""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from typing import Any, Final, Literal, TextIO, cast

from gateway.cli.kit.paint import for_terminal

#: When there is colour; `auto`: on a terminal, unless NO_COLOR is set.
Colour = Literal["auto", "always", "never"]
COLOURS: Final[tuple[Colour, ...]] = ("auto", "always", "never")


class _Escaping:
    """A stream whose text has escapes in place of control characters; `inner` has the stream itself.

    So it has in place of what the terminal's encoding lacks: a name may be in any script.
    """

    def __init__(self, inner: TextIO, *, has_colour: bool) -> None:
        self.inner = inner
        self.has_colour = has_colour

    def write(self, text: str) -> int:
        """Write the text."""
        return self.write_codes(for_terminal(text, has_colour=self.has_colour))

    def write_codes(self, text: str) -> int:
        """Write text of ours with codes for the terminal."""
        try:
            return self.inner.write(text)
        except UnicodeEncodeError:
            encoding = self.inner.encoding
            return self.inner.write(text.encode(encoding, "backslashreplace").decode(encoding))

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


@contextmanager
def no_control_characters(colour: Colour = "auto", environment: Mapping[str, str] = os.environ) -> Iterator[None]:
    """Escape control characters in what is printed inside the context, and show paint as colour where there is any."""

    def escaping(stream: TextIO) -> TextIO:
        has_colour = colour == "always" or (colour == "auto" and takes_codes(stream, environment))
        return cast("TextIO", _Escaping(stream, has_colour=has_colour))

    with ExitStack() as stack:
        if sys.stdout is not None:
            stack.enter_context(redirect_stdout(escaping(sys.stdout)))
        if sys.stderr is not None:
            stack.enter_context(redirect_stderr(escaping(sys.stderr)))
        yield


def takes_codes(stream: TextIO, environment: Mapping[str, str] = os.environ) -> bool:
    """Tell whether a stream is a terminal on which codes for colours and the cursor are welcome.

    Where TERM is not set nobody knows: they are not.
    """
    return stream.isatty() and not environment.get("NO_COLOR") and environment.get("TERM", "") not in ("", "dumb")


def write_codes(stream: TextIO, text: str) -> None:
    """Write text of ours that moves the cursor; what others said has been made `drawable` in it."""
    if isinstance(stream, _Escaping):
        stream.write_codes(text)
    else:
        stream.write(text)
    stream.flush()


def drawable(stream: TextIO, text: str) -> str:
    """Make text ready for `write_codes`: without control characters, with colour if the stream has any."""
    return for_terminal(text, has_colour=isinstance(stream, _Escaping) and stream.has_colour)
