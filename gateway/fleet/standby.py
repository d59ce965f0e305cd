"""Keeps a line's port open while its lease is held: the only part of a lease that knows clock, event loop and store."""

import asyncio
import os
from collections.abc import Awaitable, Callable
from contextlib import suppress
from time import CLOCK_BOOTTIME, clock_gettime
from typing import Final, Protocol

from gateway.errors import FleetError, PortError
from gateway.events import Emit, LeaseLost, LeaseTaken
from gateway.fleet.lease import Lease, Read, StoreCall
from gateway.fleet.lease_entry import State
from gateway.fleet.lease_settings import LeaseSettings

#: The bucket with all leases.
BUCKET: Final = "mbgw-lease"
#: How long a port may take to close, and how long the store may take when a lease is given back, in seconds.
CLOSING_TIME: Final = 0.7
RELEASE_TIME: Final = 0.5


class Found(Protocol):
    """An entry of a bucket; its value is None if it was deleted."""

    @property
    def value(self) -> bytes | None:
        """What was put there."""

    @property
    def revision(self) -> int:
        """It changes with each change of the entry."""


class Bucket(Protocol):
    """What the leases are kept in. Each call raises FleetError if nobody knows whether it was carried out."""

    async def get(self, key: str) -> Found | None:
        """The entry; None if there is none."""

    async def create(self, key: str, value: bytes) -> int | None:
        """Put an entry where none is: its revision, or None if there is one."""

    async def update(self, key: str, value: bytes, revision: int) -> int | None:
        """Replace the entry of this revision: the new one, or None if there is another entry."""


#: The bucket at hand. Raises FleetError if the store cannot be reached.
OpenBucket = Callable[[], Awaitable[Bucket]]


class SharedLine(Protocol):
    """A line on which gateways ask in turn."""

    @property
    def is_usable(self) -> bool:
        """Whether its port is open, or was not tried yet."""

    async def keep_open(self) -> None:
        """Open the port, and keep it open until cancelled."""

    def withhold(self, reason: PortError) -> None:
        """The port stays closed."""

    def state(self) -> State:
        """What moves to the next holder at any time."""

    def adopt(self, state: State) -> None:
        """Go on from what another holder has left."""

    def final_state(self) -> State:
        """What moves to the next holder when this one stops, late answers included."""


class Standby:
    """One line and its lease. `settings` are those of the lease, `holder` is what others are told of us.

    `taken` counts how often the lease was taken. It is the Permission of the line's driver.
    """

    def __init__(
        self,
        line: str,
        settings: LeaseSettings,
        holder: str,
        bucket: OpenBucket,
        shared: SharedLine,
        emit: Emit,
    ) -> None:
        self.lease = Lease(settings, holder, "")
        self.taken = 0
        self._settings = settings
        self._holder = holder
        self._line = line
        self._bucket = bucket
        self._emit = emit
        self._shared = shared
        self._keeping: asyncio.Task[None] | None = None
        #: Whether others were told that the lease is held.
        self._is_told = False
        self._unusable_since: float | None = None
        self._wake = asyncio.Event()

    @property
    def name(self) -> str:
        """The name of the lease."""
        return self._settings.name

    def may_send(self) -> bool:
        """See Permission: by CLOCK_BOOTTIME, which counts while the machine sleeps and cannot be set."""
        return _now() < self.lease.until

    def silence(self) -> float:
        """See Permission."""
        return max(0.0, self.lease.silent_until - _now())

    def heard_other(self) -> None:
        """See Permission."""
        self.lease.heard_other(_now())
        self._wake.set()

    async def run(self) -> None:
        """Ask for the lease, and have the port open while it is held, until cancelled; then give it back."""
        self.lease = Lease(self._settings, self._holder, os.urandom(8).hex())
        self._withhold()
        try:
            while True:
                await self._act()
                question = self.lease.next(_now())
                if question is None:
                    await self._pause()
                else:
                    await self._ask(question, self._settings.step)
        finally:
            await self._give_back()

    async def _pause(self) -> None:
        """Wait for the lease's deadline, or for a reason to act before it."""
        self._wake.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(max(0.0, self.lease.deadline() - _now())):
                await self._wake.wait()

    async def _ask(self, question: StoreCall, within: float) -> None:
        """Put a question to the store, and report what became of it."""
        try:
            async with asyncio.timeout(within):
                await self._put(question)
        except FleetError as error:
            self.lease.failed(str(error), _now())
        except TimeoutError:
            self.lease.failed(f"NATS did not answer within {within:.1g} s", _now())

    async def _put(self, question: StoreCall) -> None:
        bucket, key = await self._bucket(), self.name
        if isinstance(question, Read):
            entry = await bucket.get(key)
            value = None if entry is None else entry.value
            self.lease.found(value, 0 if entry is None or value is None else entry.revision, _now())
            return
        if question.revision:
            revision = await bucket.update(key, question.value, question.revision)
        else:
            revision = await bucket.create(key, question.value)
        if revision is None:
            self.lease.refused(_now())
        else:
            self.lease.written(revision, _now())

    async def _act(self) -> None:
        """Do with the port what the lease says."""
        lease, now = self.lease, _now()
        lease.tick(now)
        self._check_keeping()
        if not lease.is_held:
            await self._stop_asking()
            return
        if self._keeping is None:
            self._begin()
        lease.state = self._shared.state()
        self._watch_port(now)

    def _check_keeping(self) -> None:
        """A port that took long to close is closed at last; a defect ends the standby."""
        if self._keeping is not None and self._keeping.done():
            keeping, self._keeping = self._keeping, None
            if not keeping.cancelled():
                keeping.result()

    async def _stop_asking(self) -> None:
        """Close the port, if it is open, and say why."""
        if self._is_told:
            self._is_told = False
            self._emit(LeaseLost(self._line, self.name, self.lease.reason))
        await self._close()
        self._withhold()

    async def _close(self) -> bool:
        """Close the port; whether it is closed, for a driver may hang."""
        if self._keeping is None:
            return True
        if not self._keeping.cancelling():  # a second one would end the wait for the driver
            self._keeping.cancel()
        closed, _ = await asyncio.wait((self._keeping,), timeout=CLOSING_TIME)
        if closed:
            self._keeping = None
        return bool(closed)

    def _begin(self) -> None:
        lease = self.lease
        inherited, lease.inherited = lease.inherited, None
        if inherited is not None:
            self._shared.adopt(inherited)
        self.taken += 1
        self._is_told = True
        self._unusable_since = None
        self._emit(LeaseTaken(self._line, self.name, round(self.silence(), 1)))
        self._keeping = asyncio.create_task(self._shared.keep_open(), name=f"line:{self._line}")

    def _watch_port(self, now: float) -> None:
        """Who cannot use the line leaves it to others."""
        if self._shared.is_usable:
            self._unusable_since = None
        elif self._unusable_since is None:
            self._unusable_since = now
        elif now - self._unusable_since > self._settings.ttl:
            self.lease.give_way(now, "the port cannot be used from here")

    def _withhold(self) -> None:
        self._shared.withhold(PortError(f"standby for the lease {self.name}: {self.lease.reason}"))

    async def _give_back(self) -> None:
        """Close the port, and tell the others that the lease is free."""
        lease, was_held = self.lease, self.lease.is_held
        silent = 0.0 if await self._close() else self._settings.guard + self._settings.late
        lease.release(silent, self._shared.final_state())
        question = lease.next(_now())
        if was_held and question is not None and not isinstance(question, Read):
            await self._ask(question, RELEASE_TIME)
        if self._is_told:
            self._is_told = False
            self._emit(LeaseLost(self._line, self.name, lease.reason))


def _now() -> float:
    return clock_gettime(CLOCK_BOOTTIME)
