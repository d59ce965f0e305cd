"""What `doctor` says about the broker at which values are published."""

from collections.abc import Iterator

from gateway.diagnosis.finding import Finding
from gateway.diagnosis.last import Last
from gateway.plant.status import BrokerStatus


def findings_about(broker: BrokerStatus | None) -> Iterator[Finding]:
    """Find a broker that is not reached, or refuses; nothing without [mqtt]."""
    if broker is None:
        return
    about = f"broker {broker.broker}"
    place = f"see [mqtt] in {broker.source}"
    if broker.reason:
        yield Finding("fix", about, f"nothing is published: {broker.reason}", place)
    elif broker.unsteady:
        yield Finding("fix", about, broker.unsteady, place)
    elif broker.refused_messages:
        last = Last((broker.last_refused_ms or 0.0) / 1000)
        what = f"has refused {broker.refused_messages} messages{last}"
        yield Finding(last.level, about, what, "give the user of the gateway the right to publish there")
    elif not broker.available:
        yield Finding("note", about, "there is nothing to publish: no published device answers", "see the lines")
    else:
        yield Finding("ok", about, f"takes the values of {broker.available} of {broker.devices} devices")
