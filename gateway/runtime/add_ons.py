"""The add-ons of a running gateway: all that the other rooms know of them.

A new one has a room beside `mqtt` and `fleet`, with an AddOn, and a field here. How its section is read and checked
says `config/add_ons.py`.
"""

from typing import NamedTuple, Self

from gateway.events import Emit
from gateway.runtime.fleet.add_on import Fleet
from gateway.runtime.kept_state import KeptState
from gateway.runtime.mqtt.add_on import Publishing
from gateway.runtime.routers import MakeRouter
from gateway.tls.store import TlsStore


class AddOns(NamedTuple):
    """Each of them, whether the config asks for it or not. In this order they are told of in metrics and findings."""

    mqtt: Publishing
    fleet: Fleet

    @classmethod
    def without_plan(cls, router: MakeRouter, emit: Emit, contexts: TlsStore, kept: KeptState) -> Self:
        """Make them; they do nothing yet."""
        return cls(Publishing(router, emit, contexts, kept), Fleet(router, emit, contexts))
