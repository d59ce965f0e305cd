"""Decides when to read a port again while a response comes in byte by byte, or noise.

Each byte that wakes the gateway costs as much as the rest of a transaction, and nothing can be decided before the
response can be complete: until then the port is not read. Why the driver does not collect bytes (VMIN):
docs/adr/0011-who-looks-at-each-byte.md
"""

from math import inf
from typing import Final

#: An adapter may have delayed a byte by this many seconds (a USB frame); the next ones follow sooner then.
HELD_BACK: Final = 0.001
#: A pause ends this many bytes before the last one: the previous byte may be one character old.
LAST_BYTES_READ_SINGLY: Final = 1
#: The shortest pause that saves more than it costs, in characters.
SHORTEST_PAUSE_CHARS: Final = 2
#: The longest pause, in seconds: a lost port is noticed only when it is read.
LONGEST: Final = 0.05
#: The longest pause before bytes have proved to come at the line's rate: the rest may come at once.
LONGEST_UNPROVEN: Final = 0.002
#: The pause in noise, in seconds: at any rate, a driver can buffer the bytes that come meanwhile.
NOISE: Final = 0.005
#: So many characters before the end of a request it is seen whether anything has come before it.
_BEFORE_ITS_END: Final = 0.25
#: The precision of a byte's time of arrival, in characters.
_ROUGHLY: Final = 0.5


class Pace:
    """The arrival of bytes from a line whose longest frame has `longest` bytes."""

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._character = 0.0
        self._silence = 0.0
        self._held_back = 0.0
        #: The response: when its first bytes came, their number, and the number of all that have come.
        self._first_at = 0.0
        self._first = 0
        self._came = 0
        #: Up to when no response can begin, -inf if what comes is looked for; when the response is looked for, and when
        #: it is foreseen to be complete, 0 if that is unknown; whether nobody looks.
        self._early_until = -inf
        self._look_at = 0.0
        self._ends_at = 0.0
        self._is_awaited = False
        #: The idle line: when the last byte came, and the number of bytes since the last silence.
        self._idle_at = 0.0
        self._since_silence = 0

    def tune(self, character: float, silence: float, *, virtual: bool) -> None:
        """Set the length of a character and of the silence between frames. A `virtual` port delays no bytes."""
        self._character = character
        self._silence = silence
        self._held_back = 0.0 if virtual else HELD_BACK

    def begin(self) -> None:
        """Start anew: a request is sent."""
        self._first = self._came = self._since_silence = 0
        self._is_awaited = False
        self.foresee_nothing()

    def foresee(self, early_until: float, look_at: float, ends_at: float) -> None:
        """Expect the response to be complete at `ends_at`; if it is not an exception, whose end is at `look_at`.

        What begins before `early_until` is no response: it is looked for just before.
        """
        self._early_until = early_until
        self._look_at = look_at
        self._ends_at = ends_at

    def foresee_nothing(self) -> None:
        """Look for each byte."""
        self._early_until = -inf
        self._ends_at = 0.0

    def is_early(self, size: int, now: float) -> bool:
        """Tell whether so many bytes, the first that somebody looked for, cannot all have come since a response can."""
        return now - size * self._character < self._early_until

    @property
    def was_there(self) -> bool:
        """Whether what was read last had not been looked for before it was foreseen to be there."""
        return self._is_awaited

    def add(self, size: int, now: float) -> None:
        """Count received bytes that may be part of the response."""
        if not self._came:
            self._first_at, self._first = now, size
        self._came += size

    def add_idle(self, size: int, now: float) -> None:
        """Count received bytes on the idle line."""
        if now - self._idle_at - size * self._character > self._silence:
            self._since_silence = 0
        self._idle_at = now
        self._since_silence += size

    def read_at(self, missing: int, now: float) -> float | None:
        """Return when to read again if `missing` or more bytes of a response are still to come; None: at the next byte.

        Bytes that came faster than the line's rate do not tell when the rest comes. Only bytes after the first ones
        count, because the device may have taken its time before them. What is foreseen is not looked for before.
        """
        if self._ends_at:
            at = self._foreseen_at(missing, now)
            if at - now >= SHORTEST_PAUSE_CHARS * self._character:
                self._is_awaited = True
                return min(at, now + LONGEST)
            self.foresee_nothing()
        self._is_awaited = False
        came, character = self._came - self._first, self._character
        late = now - self._first_at - came * character
        if late < -_ROUGHLY * character:
            return None
        # Bytes that are late by more than a character come in bundles, and then the rest is already on its way.
        held_back = max(self._held_back, min(late - character, HELD_BACK))
        pause = (missing - LAST_BYTES_READ_SINGLY) * character - held_back
        pause = min(pause, LONGEST if came else LONGEST_UNPROVEN)
        return None if pause < SHORTEST_PAUSE_CHARS * character else now + pause

    def _foreseen_at(self, missing: int, now: float) -> float:
        """Return when to look for the response, or for its rest; 0 if something else has come."""
        early_at = self._early_until - _BEFORE_ITS_END * self._character
        if now < early_at:
            return early_at
        self._early_until = -inf
        if not self._came:
            return self._look_at
        return self._ends_at if missing else 0.0

    def read_idle_at(self, now: float) -> float | None:
        """Return when to read the idle line again: noise, longer than any frame, need not be read byte by byte."""
        is_noise = self._since_silence > self._longest
        return now + NOISE if is_noise and SHORTEST_PAUSE_CHARS * self._character <= NOISE else None
