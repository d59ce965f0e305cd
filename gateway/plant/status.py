"""The connection to a broker for the status."""

from dataclasses import dataclass
from typing import Literal

from gateway.config.values.duration import show_age


@dataclass(frozen=True, slots=True)
class KeptStatus:
    """The readings that wait to be sent: how many `values`, the oldest of the time `since` (RFC 3339), `age_ms` old.

    `bytes` of the file are in use; at seven eighths of the `limit` the oldest are given up, as its journal needs the
    rest. It will be full `full_in_ms` from now at the present rate; None if that is unknown. `given_up` values will
    never be sent, the last were given up `given_up_ms` ago. `trouble` says why values are kept in memory only; it is
    empty if the file can be written.
    """

    values: int
    since: str | None
    age_ms: float | None
    bytes: int
    limit: int
    full_in_ms: float | None
    given_up: int
    given_up_ms: float | None
    trouble: str


def show_kept(kept: KeptStatus) -> str:
    """Show how much is kept, and of how long: `12340 values of the last 20 min (3.1/64 MiB)`."""
    if kept.age_ms is None:
        return "none"
    return f"{kept.values} values of the last {show_age(kept.age_ms)} ({show_use(kept)})"


def show_use(kept: KeptStatus) -> str:
    """Show what is used of the disk, as in any language: `3.1/64 MiB`."""
    unit, name = (2**20, "MiB") if kept.limit >= 2**20 else (2**10, "KiB")
    return f"{kept.bytes / unit:.1f}/{kept.limit / unit:g} {name}"


@dataclass(frozen=True, slots=True)
class BrokerStatus:
    """The broker at which values are published. `reason` says why nothing is published; it is empty when all is well.

    `unsteady` says why connections were lost, each soon after it was made; it is empty once one has held for a minute.

    `down_ms` is for how long nothing has been published; None when all is well, or the library is missing. `up_ms` is
    for how long values have been published, None while they are not. `messages_per_s` is of the last seconds, and
    `waiting` messages have not been sent yet. `version` is the version of MQTT. `available` of the `devices` respond.
    `messages` counts those that the broker has confirmed, `refused_messages` those that it has refused, the last one
    `last_refused_ms` ago. `polls` counts reads of points, `failed_polls` those that failed. `kept` is None unless
    values are kept while the broker is away.
    """

    broker: str
    source: str
    state: Literal["up", "down"]
    reason: str
    down_ms: float | None
    version: str
    attempts: int
    devices: int
    available: int
    points: int
    messages: int
    refused_messages: int
    commands: int
    refused_commands: int
    polls: int
    failed_polls: int
    last_refused_ms: float | None = None
    unsteady: str = ""
    up_ms: float | None = None
    messages_per_s: float = 0.0
    waiting: int = 0
    kept: KeptStatus | None = None
