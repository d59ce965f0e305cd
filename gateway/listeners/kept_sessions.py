"""Limits the TLS 1.2 sessions that are kept for clients without tickets, for each address."""

import asyncio
import ssl
from collections.abc import Callable
from math import inf
from typing import Final

from gateway.clock.threads import ThreadPerCall
from gateway.tls.contexts import Loaded, load
from gateway.tls.settings import ServerTls

#: With more sessions, a new context replaces the one in use. A session takes 10 KiB, and OpenSSL would keep 20 480.
MOST_SESSIONS: Final = 500
#: Without a new context, no further sessions are kept above this number.
MOST_AFTER_CLOSING: Final = 1000
#: The pause before files are read again that could not be used, or differ from those in use, in seconds.
PAUSE: Final = 60.0

#: Takes the context used so far, and its replacement.
Replace = Callable[[Loaded, Loaded], None]


def is_full(context: ssl.SSLContext) -> bool:
    """Tell whether a context must keep no more sessions: it could not be replaced in time."""
    return context.session_stats()["number"] > MOST_AFTER_CLOSING


class KeptSessions:
    """Replaces the context of an address that keeps too many sessions: the only way to forget them all.

    `in_use` returns the context loaded from `files`. `replace` takes that and its replacement, and uses the latter if
    the former is still in use.
    """

    def __init__(self, files: ServerTls, in_use: Callable[[], Loaded], replace: Replace) -> None:
        self._files = files
        self._in_use = in_use
        self._replace = replace
        #: Reading the files, in a thread; None while nothing is read.
        self.renewing: asyncio.Future[Loaded] | None = None
        #: The earliest time to read them again, by the loop's clock.
        self._next_at = -inf

    def limit(self) -> None:
        """Start making a new context if the one in use keeps too many sessions."""
        before = self._in_use()
        if self.renewing is not None or before.context.session_stats()["number"] <= MOST_SESSIONS:
            return
        loop = asyncio.get_running_loop()
        if loop.time() < self._next_at:
            return
        self._next_at = loop.time() + PAUSE

        def renewed(renewing: asyncio.Future[Loaded]) -> None:
            self.renewing = None
            if not renewing.cancelled() and renewing.exception() is None:
                self._adopt(before, renewing.result())

        self.renewing = loop.run_in_executor(ThreadPerCall("read certificates"), load, self._files)
        self.renewing.add_done_callback(renewed)

    def _adopt(self, before: Loaded, fresh: Loaded) -> None:
        """Use the new context, unless the files have changed: only a reload may use those."""
        if fresh.trust == before.trust and fresh.expiries == before.expiries:
            self._replace(before, fresh)
            self._next_at = -inf
