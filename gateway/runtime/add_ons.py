"""The add-ons of a running gateway; other rooms use only this list.

A new one has a room beside `mqtt` and `fleet`, with an AddOn, and a field here. `config/add_ons.py` reads and checks
its section.
"""

from typing import NamedTuple, Self

from gateway.events import Emit
from gateway.images.drivers.polls_driver import Pollers
from gateway.runtime.fleet.add_on import Fleet
from gateway.runtime.kept_state import KeptState
from gateway.runtime.mqtt.add_on import Publishing
from gateway.runtime.routers import MakeRouter
from gateway.tls.store import TlsStore


class AddOns(NamedTuple):
    """All add-ons, configured or not, in the order of metrics and findings."""

    mqtt: Publishing
    fleet: Fleet

    @classmethod
    def without_plan(
        cls, router: MakeRouter, emit: Emit, contexts: TlsStore, kept: KeptState, pollers: Pollers
    ) -> Self:
        """Make them; they do nothing yet."""
        return cls(Publishing(router, emit, contexts, kept, pollers), Fleet(router, emit, contexts))
