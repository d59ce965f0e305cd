"""Opens a line's port while its lease is held; connects the lease to clock, event loop and store."""

import asyncio
import os
from collections.abc import Awaitable, Callable
from contextlib import suppress
from time import CLOCK_BOOTTIME, clock_gettime
from typing import TYPE_CHECKING, Final, Protocol

from gateway.errors import FleetError, PortError
from gateway.events import Emit, LeaseLost, LeaseTaken
from gateway.fleet.lease import Lease, LeaseSettings, Read, StoreCall
from gateway.fleet.lease_entry import State

if TYPE_CHECKING:
    from gateway.fleet.bucket import Bucket

#: How long a port may take to close, and the store to take back a lease, in seconds.
CLOSING_TIME: Final = 0.7
RELEASE_TIME: Final = 0.5


#: Opens the bucket of the leases. Raises FleetError if the store cannot be reached.
OpenBucket = Callable[[], Awaitable["Bucket"]]


class SharedLine(Protocol):
    """A line that several gateways may use, one at a time."""

    @property
    def is_usable(self) -> bool:
        """Whether its port is open, or was not tried yet."""

    async def keep_open(self) -> None:
        """Open the port, and keep it open until cancelled."""

    def withhold(self, reason: PortError) -> None:
        """Keep the port closed for this reason."""

    def state(self) -> State:
        """Return the state that the next holder would get now."""

    def adopt(self, state: State) -> None:
        """Continue from the state of another holder."""

    def final_state(self) -> State:
        """Return the state for the next holder when this one stops, late answers included."""


class Standby:
    """One line and its lease with these `settings`; the Permission of the line's driver.

    `holder` is how other gateways know this one. `taken` counts how often the lease was taken.
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
        #: Whether LeaseTaken was emitted for the lease that is held.
        self._is_told = False
        self._unusable_since: float | None = None
        self._wake = asyncio.Event()

    @property
    def name(self) -> str:
        """The name of the lease."""
        return self._settings.name

    def may_send(self) -> bool:
        """Tell whether the share lasts, by CLOCK_BOOTTIME: it counts during suspend and cannot be set."""
        return _now() < self.lease.until

    def silence(self) -> float:
        """Return how long the line must still be silent, in seconds."""
        return max(0.0, self.lease.silent_until - _now())

    def heard_other(self) -> None:
        """Give up the lease: another client was heard."""
        self.lease.heard_other(_now())
        self._wake.set()

    async def run(self) -> None:
        """Claim the lease, and keep the port open while it is held, until cancelled; then release it."""
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
        """Wait for the lease's deadline, or an earlier reason to act."""
        self._wake.clear()
        with suppress(TimeoutError):
            async with asyncio.timeout(max(0.0, self.lease.deadline() - _now())):
                await self._wake.wait()

    async def _ask(self, question: StoreCall, within: float) -> None:
        """Send a call to the store, and report its result to the lease."""
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
            value, seen = (None, 0) if entry is None else (entry.value, entry.revision)
            self.lease.found(value, seen, _now())
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
        """Open or close the port as the lease requires."""
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
        """Notice that a slow port has closed at last. A defect in it ends the standby."""
        if self._keeping is not None and self._keeping.done():
            keeping, self._keeping = self._keeping, None
            if not keeping.cancelled():
                keeping.result()

    async def _stop_asking(self) -> None:
        """Close the port if it is open, and record why."""
        if self._is_told:
            self._is_told = False
            self._emit(LeaseLost(self._line, self.name, self.lease.reason))
        await self._close()
        self._withhold()

    async def _close(self) -> bool:
        """Close the port. Return False if its driver hangs."""
        if self._keeping is None:
            return True
        if not self._keeping.cancelling():  # cancelling twice would end the wait for the driver
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
        """Release the lease if the port stays unusable for a time to live."""
        if self._shared.is_usable:
            self._unusable_since = None
        elif self._unusable_since is None:
            self._unusable_since = now
        elif now - self._unusable_since > self._settings.ttl:
            self.lease.give_way(now, "the port cannot be used from here")

    def _withhold(self) -> None:
        self._shared.withhold(PortError(f"standby for the lease {self.name}: {self.lease.reason}"))

    async def _give_back(self) -> None:
        """Close the port, and release the lease."""
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
