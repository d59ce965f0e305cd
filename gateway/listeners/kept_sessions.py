"""The sessions of TLS 1.2 that are kept for clients that take no tickets: a bounded number for each address."""

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
#: If there is no new context, no further sessions are kept above this number.
MOST_AFTER_CLOSING: Final = 1000
#: How long files that cannot be used, or are others by now, are not read again, in seconds.
PAUSE: Final = 60.0

#: Takes what was used before, and what to use in its place.
Replace = Callable[[Loaded, Loaded], None]


def is_full(context: ssl.SSLContext) -> bool:
    """Return True if a context must keep no more sessions: its files could not be used again."""
    return context.session_stats()["number"] > MOST_AFTER_CLOSING


class KeptSessions:
    """Replaces the context of an address when it keeps too many: that is the only way to forget them all.

    `in_use` is what was loaded from `files`. `replace` takes that and what to use in its place, if it is still in use.
    """

    def __init__(self, files: ServerTls, in_use: Callable[[], Loaded], replace: Replace) -> None:
        self._files = files
        self._in_use = in_use
        self._replace = replace
        #: Reads the files in a thread.
        self.renewing: asyncio.Future[Loaded] | None = None
        #: When they may be read again, in seconds of the loop's clock.
        self._next_at = -inf

    def limit(self) -> None:
        """Begin to make a new context if the one in use keeps too many sessions."""
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
        """Use the new context, unless the files are others by now, which only a reload may take."""
        if fresh.trust == before.trust and fresh.expiries == before.expiries:
            self._replace(before, fresh)
            self._next_at = -inf
