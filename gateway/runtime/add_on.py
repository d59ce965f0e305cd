"""What each add-on of a running gateway does: a part that the config adds with one section of its own."""

from collections.abc import Iterable
from typing import ClassVar

from gateway.diagnosis.finding import Finding
from gateway.observe.families import Family
from gateway.routing.router import Router
from gateway.runtime.gateway import Gateway


class AddOn:
    """Works as long as the plan of the gateway has the section `key`; its requests come in by `router`.

    What is not needed is left as it is here: it does nothing. `shown_as` is the field of the status that has its own.
    """

    key: ClassVar[str]
    shown_as: ClassVar[str]

    def __init__(self, router: Router) -> None:
        self.router = router

    def rerouted(self, gateway: Gateway) -> None:
        """Stop what means something else by the routes of `gateway`, which apply from now on."""

    async def connect(self, gateway: Gateway) -> None:
        """Connect as the plan says: before ports are opened, and in each reload. An unchanged connection is kept."""

    async def serve(self, gateway: Gateway) -> None:
        """Do what the plan says: once clients can connect, and in each reload after all have connected."""

    @property
    def is_busy(self) -> bool:
        """Whether somebody waits for a response."""
        return False

    async def leave(self) -> None:
        """Take no more requests, and say goodbye, while others finish theirs."""
        await self.stop()

    async def stop(self) -> None:
        """End what has not left."""

    def status(self) -> object | None:
        """Tell its state, and its counters; None if the plan has no such section."""
        return None

    def metrics(self) -> Iterable[Family]:
        """Read its counters for a scrape."""
        return ()

    def findings(self) -> Iterable[Finding]:
        """Tell what may be wrong with it, and the remedy."""
        return ()
