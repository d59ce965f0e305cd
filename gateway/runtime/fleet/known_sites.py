"""What is known of the sites of a fleet: for whoever looks at all of them, and for metrics of those asked from here."""

import asyncio
from collections.abc import Awaitable, Callable, Collection, Sequence
from math import inf
from typing import Final

from gateway.errors import FleetError
from gateway.fleet.status import SiteStatus

#: Seconds between looks for metrics, and how long one may take.
LOOKED: Final = 60.0
_LOOKING_TIME: Final = 2.0

#: Reads what all sites say, or these and this one. Raises FleetError.
ReadSites = Callable[[Collection[str] | None], Awaitable[Sequence[SiteStatus]]]


class KnownSites:
    """The sites as they were last read by `read`, which costs a request for each of them."""

    def __init__(self, read: ReadSites) -> None:
        #: The sites that are asked from here.
        self.asked: Sequence[SiteStatus] = ()
        self._read = read
        self._all: Sequence[SiteStatus] = ()
        self._read_at = self._looked_at = -inf
        self._one_at_a_time = asyncio.Lock()

    async def all(self, kept: float) -> Sequence[SiteStatus]:
        """List all sites, by name; the list may be `kept` seconds old.

        Raises:
            FleetError: they are not known.
        """
        async with self._one_at_a_time:
            now = asyncio.get_running_loop().time()
            if now - self._read_at >= kept:
                self._all, self._read_at = await self._read(None), now
            return self._all

    async def look(self, sites: Collection[str]) -> None:
        """Read `sites`, those that are asked from here, unless this was done in the last minute."""
        now = asyncio.get_running_loop().time()
        if now - self._looked_at < LOOKED:
            return
        self._looked_at = now
        try:
            async with asyncio.timeout(_LOOKING_TIME):
                read = await self._read(sites) if sites else ()
            self.asked = [each for each in read if each.site in sites]
        except (FleetError, TimeoutError):
            self.asked = ()
