"""What each add-on of a running gateway does: a part that the config adds with one section of its own."""

from collections.abc import Iterable
from typing import ClassVar

from gateway.diagnosis.finding import Finding
from gateway.observe.families import Family
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway


class AddOn:
    """A part that works while the plan of the gateway has the section `key`; its requests come in by `router`.

    Methods do nothing unless they are overridden. `shown_as` is its field of the status.
    """

    key: ClassVar[str]
    shown_as: ClassVar[str]

    def __init__(self, router: Router) -> None:
        self.router = router

    def rerouted(self, gateway: Gateway) -> None:
        """Stop what has another meaning by the routes of `gateway`, which apply from now on."""

    async def connect(self, gateway: Gateway) -> None:
        """Connect as the plan says: before ports are opened, and in each reload. An unchanged connection is kept."""

    async def serve(self, gateway: Gateway) -> None:
        """Do what the plan says: once clients can connect, and in each reload after all have connected."""

    @property
    def is_busy(self) -> bool:
        """Whether a client waits for a response."""
        return False

    async def leave(self) -> None:
        """Take no more requests, and announce that it leaves, while other parts finish theirs."""
        await self.stop()

    async def stop(self) -> None:
        """Stop what still runs."""

    def status(self) -> object | None:
        """Return its state and its counters; None if the plan has no such section."""
        return None

    async def look(self) -> None:
        """Find out what its metrics need, unless it is known; do not wait for long."""

    def metrics(self) -> Iterable[Family]:
        """Return its metrics."""
        return ()

    def findings(self) -> Iterable[Finding]:
        """Return what may be wrong with it, and the remedies."""
        return ()
