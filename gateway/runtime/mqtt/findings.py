"""What `doctor` says about the broker at which values are published."""

from collections.abc import Iterator
from typing import Final

from gateway.config.values.duration import show_age
from gateway.diagnosis.finding import Finding
from gateway.diagnosis.last import Last
from gateway.plant.status import BrokerStatus, KeptStatus, show_kept

#: Room that lasts for less than so many milliseconds is to be seen to.
_SOON_FULL: Final = 3_600_000.0


def findings_about(broker: BrokerStatus | None) -> Iterator[Finding]:
    """Find a broker that is not reached, or refuses, and what is kept for it; nothing without [mqtt]."""
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
    is_away = broker.down_ms is not None
    if broker.kept is not None:
        yield from _about_kept(about, broker.kept, is_away=is_away)
    elif is_away:
        what = "nothing is kept while it is away: of each point only the last value will be published"
        yield Finding("note", about, what, f'keep = "64 MiB" in [mqtt] of {broker.source} keeps all')


def _about_kept(about: str, kept: KeptStatus, *, is_away: bool) -> Iterator[Finding]:
    if kept.values:
        yield Finding("note" if is_away else "ok", about, f"{show_kept(kept)} wait to be sent")
    if kept.given_up:
        last = Last((kept.given_up_ms or 0.0) / 1000)
        what = f"{kept.given_up} kept values were given up and will never be sent{last}"
        yield Finding(last.level, about, what, "modbus-gateway events says why: values_given_up")
    if kept.trouble:
        what = f"values are kept in memory only, and the last ones alone: {kept.trouble}"
        yield Finding("fix", about, what, "the user of the gateway must be able to write, with room")
    elif is_away and kept.full_in_ms is not None and kept.full_in_ms < _SOON_FULL:
        when = f"lasts for {show_age(kept.full_in_ms)} more; then" if kept.full_in_ms else "is used up:"
        what = f"the room for kept values {when} the oldest are given up"
        yield Finding("fix", about, what, "bring the broker back, or raise keep in [mqtt]")
