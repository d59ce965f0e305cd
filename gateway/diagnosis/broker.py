"""Rules about the broker at which values are published."""

from collections.abc import Iterator
from dataclasses import dataclass

from gateway.diagnosis.finding import Finding
from gateway.diagnosis.last import NOW, Last


@dataclass(frozen=True, slots=True)
class BrokerEvidence:
    """A broker by its address. `reason` says why nothing is published there; it has refused so many messages.

    `unsteady` says why connections to it do not hold.
    """

    address: str
    source: str
    reason: str
    devices: int
    available: int
    refused: int
    last_refused: Last = NOW
    unsteady: str = ""


def about_broker(broker: BrokerEvidence) -> Iterator[Finding]:
    """A broker that is not reached, or refuses."""
    about = f"broker {broker.address}"
    place = f"see [mqtt] in {broker.source}"
    if broker.reason:
        yield Finding("fix", about, f"nothing is published: {broker.reason}", place)
    elif broker.unsteady:
        yield Finding("fix", about, broker.unsteady, place)
    elif broker.refused:
        what = f"has refused {broker.refused} messages{broker.last_refused}"
        yield Finding(broker.last_refused.level, about, what, "give the user of the gateway the right to publish there")
    else:
        yield Finding("ok", about, f"takes the values of {broker.available} of {broker.devices} devices")
