"""The tables of `status`: where their rows come from, and what stands in each column."""

from collections.abc import Iterator
from math import ceil
from typing import Any, Final, NamedTuple

from gateway.cli.kit.columns import Table
from gateway.cli.kit.paint import red, yellow
from gateway.cli.show.advice import count_failed, count_ok
from gateway.config.values.duration import show_age, show_duration
from gateway.config.values.unitset import show_unit
from gateway.fleet.status import FleetStatus
from gateway.operator.operations.answers.status import (
    ClientStatus,
    ImageStatus,
    LeaseStatus,
    LineStatus,
    LineUserStatus,
    ListenerStatus,
    MirrorStatus,
    MonitorStatus,
    ServerStatus,
    Status,
    UnitStatus,
    UnknownUnitStatus,
    UpstreamStatus,
    VirtualStatus,
)
from gateway.plant.status import BrokerStatus, KeptStatus, show_use
from gateway.state.status import StateFileStatus
from gateway.tls.status import EARLY, CertificateStatus

#: The text of an empty cell.
_NOTHING: Final = "-"
#: States in red and in yellow.
_BROKEN: Final = frozenset({"down", "resting", "line down", "lost", "cannot be read"})
_DOUBTFUL: Final = frozenset({"failing", "silent"})
#: At most this many users of each line are shown.
_USERS_SHOWN: Final = 3


class _User(NamedTuple):
    """Who uses a line, and the number of the unit for clients, which is not its address on the wire."""

    line: str
    unit: str
    user: LineUserStatus


class _UnknownUnit(NamedTuple):
    """A unit that was heard on a line."""

    line: str
    unit: UnknownUnitStatus


def was_asked(unit: UnitStatus) -> bool:
    """Tell whether there is anything to show of a unit: it was asked, or was to be, or is not fine."""
    counts = unit.counts
    return bool(counts.sent or counts.refused or unit.state != "fine" or count_failed(counts))


def _asked_units(status: Status) -> list[UnitStatus]:
    return [unit for unit in status.units if was_asked(unit)]


def _users(status: Status) -> Iterator[_User]:
    """Find who takes most of each line's time."""
    numbers = {unit.name: show_unit(unit.unit) for unit in status.units}
    lines: tuple[LineStatus | MonitorStatus, ...] = (*status.lines, *status.monitors)
    for line in lines:
        for user in line.users[:_USERS_SHOWN]:
            if user.share:
                yield _User(line.name, numbers.get(user.device, _NOTHING), user)


def _unknown_units(status: Status) -> list[_UnknownUnit]:
    return [_UnknownUnit(line.name, unit) for line in status.monitors for unit in line.unknown_units]


def _speed(line: LineStatus | ServerStatus | MonitorStatus) -> str:
    return f"{line.baud} {line.format}"


def painted(state: str) -> str:
    """Paint the state of anything."""
    return red(state) if state in _BROKEN else yellow(state) if state in _DOUBTFUL else state


def _state(unit: UnitStatus) -> str:
    """Give the state; one that was asked and has never answered in time is not `fine`."""
    has_failed = unit.state == "fine" and count_failed(unit.counts) and not count_ok(unit.counts)
    return painted("failing" if has_failed else unit.state)


def _until(certificate: CertificateStatus) -> str:
    left = certificate.days_left
    return red(certificate.until) if left <= 0 else yellow(certificate.until) if left < EARLY else certificate.until


def _answered(unit: UnitStatus) -> str:
    """Give the share of requests that were answered; 100 % only if all were."""
    ok, failed = count_ok(unit.counts), count_failed(unit.counts)
    return _NOTHING if not ok + failed else f"{100 * ok // (ok + failed)} %"


def _ages(mirror: MirrorStatus) -> str:
    return ", ".join(f"{each.addresses}: {_age_of_values(each.age_ms)}" for each in mirror.ranges)


def _sources(virtual: VirtualStatus) -> str:
    text = f"{virtual.fresh_sources} of {len(virtual.sources)} fresh"
    return text if virtual.fresh_sources == len(virtual.sources) else yellow(text)


def _age_of_values(age: float | None) -> str:
    return "not known" if age is None else f"{age / 1000:.1f} s"


def _age(age: float | None) -> str:
    return _NOTHING if age is None else show_age(age)


def _milliseconds(value: float | None) -> str:
    return _NOTHING if value is None else f"{value:.1f}" if value < 10 else f"{value:.0f}"


def _longest_wait(milliseconds: float) -> str:
    return show_duration(ceil(milliseconds / 10) / 100) if milliseconds else _NOTHING


def _share(share: float | None) -> str:
    return _NOTHING if share is None else f"{100 * share:.0f} %"


def _per_second(rate: float | None) -> str:
    return _NOTHING if rate is None else f"{rate:.1f}"


TABLES: Final[tuple[Table[Status, Any], ...]] = (
    Table[Status, StateFileStatus](
        "State directory",
        lambda status: status.state_files,
        {"FILE": lambda file: file.file, "STATE": lambda file: red(file.state), "REASON": lambda file: file.reason},
    ),
    Table[Status, LineStatus](
        "Lines (busy and requests/s: of the last minute)",
        lambda status: status.lines,
        {
            "NAME": lambda line: line.name,
            "PORT": lambda line: line.port,
            "SPEED": _speed,
            "STATE": lambda line: painted(line.state),
            "BUSY": lambda line: _share(line.busy_share),
            "REQ/S": lambda line: _per_second(line.requests_per_s),
            "WAITING": lambda line: line.queue,
            "ERRORS": lambda line: count_failed(line.counts),
        },
    ),
    Table[Status, _User](
        "Users of the lines (of the last minute)",
        _users,
        {
            "LINE": lambda row: row.line,
            "CLIENT": lambda row: row.user.client,
            "UNIT": lambda row: row.unit,
            "DEVICE": lambda row: row.user.device,
            "FUNCTION": lambda row: row.user.function or _NOTHING,
            "SHARE": lambda row: f"{100 * row.user.share:.1f} %",
            "REQ/S": lambda row: f"{row.user.requests_per_s:.1f}",
        },
    ),
    Table[Status, UnitStatus](
        "Units (answer times in ms)",
        _asked_units,
        {
            "UNIT": lambda unit: show_unit(unit.unit),
            "AT": lambda unit: f"{unit.line}/{unit.on_the_wire}",
            "DEVICE": lambda unit: unit.name,
            "STATE": _state,
            "LAST": lambda unit: _age(unit.last_answer_ms),
            "P50": lambda unit: _milliseconds(unit.times.answer_p50_ms),
            "P99": lambda unit: _milliseconds(unit.times.answer_p99_ms),
            "LIMIT": lambda unit: _milliseconds(unit.times.limit_ms),
            "ANSWERED": _answered,
            "MAX-WAIT": lambda unit: _longest_wait(unit.longest_wait_ms),
        },
    ),
    Table[Status, CertificateStatus](
        "Certificates",
        lambda status: status.certificates,
        {
            "USED BY": lambda one: one.used_by,
            "KEY": lambda one: one.key,
            "FILE": lambda one: one.file,
            "SUBJECT": lambda one: one.subject,
            "UNTIL": _until,
        },
    ),
    Table[Status, UpstreamStatus](
        "Upstreams",
        lambda status: status.upstreams,
        {
            "NAME": lambda upstream: upstream.name,
            "ADDRESS": lambda upstream: upstream.to,
            "STATE": lambda upstream: painted(upstream.state),
            "BUSY": lambda upstream: _share(upstream.busy_share),
            "REQ/S": lambda upstream: _per_second(upstream.requests_per_s),
            "WAITING": lambda upstream: upstream.queue,
            "OK": lambda upstream: count_ok(upstream.counts),
            "ERRORS": lambda upstream: count_failed(upstream.counts),
        },
    ),
    Table[Status, BrokerStatus](
        "Broker",
        lambda status: status.brokers,
        {
            "ADDRESS": lambda broker: broker.broker,
            "STATE": lambda broker: painted(broker.state),
            "DOWN FOR": lambda broker: _age(broker.down_ms),
            "REASON": lambda broker: broker.reason or broker.unsteady,
            "DEVICES": lambda broker: f"{broker.available} of {broker.devices}",
            "MESSAGES": lambda broker: broker.messages,
            "REFUSED": lambda broker: broker.refused_messages,
            "COMMANDS": lambda broker: broker.commands,
            "POLLS": lambda broker: broker.polls,
            "FAILED": lambda broker: broker.failed_polls,
        },
    ),
    Table[Status, KeptStatus](
        "Kept for the broker",
        lambda status: [each.kept for each in status.brokers if each.kept is not None],
        {
            "VALUES": lambda kept: kept.values,
            "OLDEST": lambda kept: _age(kept.age_ms),
            "DISK": show_use,
            "FULL IN": lambda kept: _age(kept.full_in_ms),
            "GIVEN UP": lambda kept: yellow(str(kept.given_up)) if kept.given_up else 0,
            "TROUBLE": lambda kept: red(kept.trouble) if kept.trouble else _NOTHING,
        },
    ),
    Table[Status, LeaseStatus](
        "Leases",
        lambda status: status.leases,
        {
            "LEASE": lambda lease: lease.name,
            "LINE": lambda lease: lease.line,
            "HELD HERE": lambda lease: "yes" if lease.is_held else "no",
            "HOLDER": lambda lease: lease.holder,
            "TAKEN": lambda lease: lease.taken,
            "NATS": lambda lease: yellow(lease.trouble) or "answers",
        },
    ),
    Table[Status, FleetStatus](
        "Fleet",
        lambda status: status.fleets,
        {
            "NATS": lambda fleet: fleet.server,
            "SITE": lambda fleet: fleet.site,
            "STATE": lambda fleet: painted(fleet.state),
            "DOWN FOR": lambda fleet: _age(fleet.down_ms),
            "REASON": lambda fleet: fleet.reason,
            "REQUESTS": lambda fleet: fleet.requests,
            "RESPONSES": lambda fleet: fleet.responses,
            "EXPIRED": lambda fleet: fleet.expired,
        },
    ),
    Table[Status, ServerStatus](
        "Server lines",
        lambda status: status.servers,
        {
            "NAME": lambda server: server.name,
            "PORT": lambda server: server.port,
            "SPEED": _speed,
            "STATE": lambda server: painted(server.state),
            "ANSWERED": lambda server: server.counts.responses,
        },
    ),
    Table[Status, MonitorStatus](
        "Monitor lines, which only listen (busy and requests/s: of the last minute)",
        lambda status: status.monitors,
        {
            "NAME": lambda monitor: monitor.name,
            "PORT": lambda monitor: monitor.port,
            "SPEED": _speed,
            "STATE": lambda monitor: painted(monitor.state),
            "LAST": lambda monitor: _age(monitor.heard_ms),
            "BUSY": lambda monitor: _share(monitor.busy_share),
            "REQ/S": lambda monitor: _per_second(monitor.requests_per_s),
            "REQUESTS": lambda monitor: monitor.counts.requests,
            "ANSWERS": lambda monitor: monitor.counts.answers,
            "VALUES": lambda monitor: monitor.counts.sure,
            "NOISE": lambda monitor: monitor.counts.noise,
        },
    ),
    Table[Status, _UnknownUnit](
        "Units that were heard and are not configured",
        _unknown_units,
        {
            "LINE": lambda row: row.line,
            "ON THE WIRE": lambda row: row.unit.on_the_wire,
            "REQUESTS": lambda row: row.unit.requests,
        },
    ),
    Table[Status, ImageStatus](
        "Images",
        lambda status: [image for image in status.images if not image.python],
        {
            "UNIT": lambda image: image.unit,
            "NAME": lambda image: image.name,
            "REQUESTS": lambda image: image.requests,
            "EXCEPTIONS": lambda image: image.exceptions,
        },
    ),
    Table[Status, ImageStatus](
        "Units made in Python",
        lambda status: [image for image in status.images if image.python],
        {
            "UNIT": lambda image: image.unit,
            "NAME": lambda image: image.name,
            "CLASS": lambda image: image.python,
            "STATE": lambda image: painted(image.state),
            "REQUESTS": lambda image: image.requests,
            "EXCEPTIONS": lambda image: image.exceptions,
        },
    ),
    Table[Status, MirrorStatus](
        "Mirrors",
        lambda status: status.mirrors,
        {
            "UNIT": lambda mirror: mirror.unit,
            "NAME": lambda mirror: mirror.name,
            "OF": lambda mirror: mirror.of,
            "REQUESTS": lambda mirror: mirror.requests,
            "AGES": _ages,
        },
    ),
    Table[Status, VirtualStatus](
        "Virtual units",
        lambda status: status.virtual,
        {
            "UNIT": lambda virtual: virtual.unit,
            "NAME": lambda virtual: virtual.name,
            "SOURCES": _sources,
            "REQUESTS": lambda virtual: virtual.requests,
            "EXCEPTIONS": lambda virtual: virtual.exceptions,
            "POLLS FAILED": lambda virtual: virtual.failed_polls,
            "OLDEST": lambda virtual: _age_of_values(virtual.age_ms),
        },
    ),
    Table[Status, ListenerStatus](
        "Listeners",
        lambda status: status.listeners,
        {
            "NAME": lambda listener: listener.name,
            "ADDRESS": lambda listener: listener.address,
            "CLIENTS": lambda listener: listener.clients,
            "REJECTED": lambda listener: listener.rejected,
        },
    ),
    Table[Status, ClientStatus](
        "Clients",
        lambda status: status.clients,
        {
            "CLIENT": lambda client: client.client,
            "LISTENER": lambda client: client.listener,
            "LAST": lambda client: _age(client.asked_ms),
        },
    ),
)
