"""The status of all sites of a fleet, in a bucket: this site's own entry, and those of the others."""

import asyncio
import json
import re
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final, Literal

from gateway.clock.times import rfc_3339
from gateway.errors import FleetError
from gateway.events import Emit, PartFailed
from gateway.fleet.headers import text_of
from gateway.fleet.inventory import MOST_NAMES, age_in, count_in, inventory_in
from gateway.fleet.messages import Entry
from gateway.fleet.status import SiteStatus
from gateway.fleet.subjects import STATUS

if TYPE_CHECKING:
    from gateway.fleet.bucket import Bucket
    from gateway.fleet.connection import NatsConnection

#: Seconds between renewals of an entry, and the age at which a site counts as lost.
PERIOD: Final = 10.0
LOST_AFTER: Final = 35.0
#: Seconds between attempts while a site has no status yet.
_START: Final = 0.5

_NUMBER: Final = re.compile(r"([0-9]{1,18})")

#: The status of a gateway, as JSON values.
Told = Mapping[str, Any]


class Presence:
    """Keeps the entry of `site` up to date with the result of `tell`; a Member of the link."""

    def __init__(self, site: str, tell: Callable[[], Told], emit: Emit, unix: Callable[[], float]) -> None:
        self.site = site
        #: Why other sites do not see this one; empty if they do.
        self.reason = "not tried yet"
        self._tell = tell
        self._emit = emit
        self._unix = unix
        self._connection: NatsConnection | None = None
        self._task: asyncio.Task[None] | None = None

    async def connected(self, connection: "NatsConnection") -> None:
        """Renew the entry from now on."""
        self._connection = connection
        self._task = asyncio.create_task(self._renew(), name="fleet: presence")

    def disconnected(self) -> None:
        """Stop renewing the entry."""
        self._connection = None
        self.reason = "NATS cannot be reached"
        if self._task is not None:
            self._task.cancel()

    async def leave(self) -> None:
        """Mark this site as left."""
        if self._task is not None:
            self._task.cancel()
        with suppress(FleetError):
            await self._put("left")

    async def sites(self, only: Collection[str] | None = None) -> list[SiteStatus]:
        """Read the status of all sites, or of those in `only` and this one; sorted by name.

        Raises:
            FleetError: the bucket cannot be read.
        """
        with suppress(FleetError):
            await self._put("up")
        keys = None if only is None else {*only, self.site}
        entries = await (await self._bucket()).entries(keys)
        # The server's time, from our own entry just stored there: no two clocks are compared.
        mine = next((each.created for each in entries if each.key == self.site and not self.reason), None)
        now = mine or self._unix()
        return [status_of(each, now) for each in sorted(entries, key=lambda entry: _counting(entry.key))]

    async def _renew(self) -> None:
        while True:
            try:
                await self._put("up")
            except FleetError as error:
                self.reason = str(error)
            except Exception as error:  # noqa: BLE001 - an error boundary: requests do not need this
                self._emit(PartFailed.of("fleet", error))
            await asyncio.sleep(PERIOD if self._tell() else _START)

    async def _put(self, state: str) -> None:
        told = self._tell()
        if not told:
            raise FleetError("it has just started")
        body = json.dumps({**told, "state": state}, separators=(",", ":")).encode()
        await (await self._bucket()).put(self.site, body)
        self.reason = ""

    async def _bucket(self) -> "Bucket":
        if self._connection is None:
            raise FleetError("NATS cannot be reached")
        return await self._connection.bucket(STATUS)


def status_of(entry: Entry, now: float) -> SiteStatus:
    """Decode an entry at `now`, by the server's clock."""
    created = entry.created or now
    age = max(0.0, now - created)
    try:
        told = json.loads(entry.value)
        state: Literal["up", "left", "lost"] = "left" if told["state"] == "left" else "up"
        if state == "up" and age > LOST_AFTER:
            state = "lost"
        up = age_in(told["up_s"])
        return SiteStatus(
            site=text_of(entry.key),
            state=state,
            for_s=round(up + age if state == "up" else age, 1),
            started=rfc_3339(created - up, "seconds"),
            host=text_of(str(told["host"])),
            version=text_of(str(told["version"])),
            lines=count_in(told["lines"]),
            lines_down=tuple(text_of(str(each)) for each in told["lines_down"][:MOST_NAMES]),
            units=count_in(told["units"]),
            inventory=inventory_in(told.get("inventory"), created),
        )
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
        return SiteStatus(text_of(entry.key), "cannot be read", round(age, 1), "", "", "", 0, (), 0)


def _counting(name: str) -> list[str | int]:
    """Make the key by which plant-2 comes before plant-10."""
    return [int(part) if at % 2 else part for at, part in enumerate(_NUMBER.split(name))]
