"""The status of a gateway: one snapshot for all commands and pages.

Counts are since the start. Durations have their unit in their name.
"""

import asyncio
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from gateway.clock.slices import in_slices
from gateway.clock.times import milliseconds
from gateway.devices.device import Device
from gateway.errors import WrongQuestion
from gateway.operator.operations.answers.status import (
    AnyLine,
    ClientStatus,
    ImageStatus,
    Lines,
    ListenerStatus,
    MirrorStatus,
    RejectionStatus,
    Status,
    UnitStatus,
    VirtualStatus,
)
from gateway.operator.operations.answers.unit_status import UnitWithStatus
from gateway.operator.operations.asked import OneLine, OneUnit
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operations.parameters import fields_of
from gateway.operator.operator import Operator
from gateway.operator.status.line_status import leases, line_status, monitor_status, server_status, upstream_status
from gateway.operator.status.troubles import troubles
from gateway.operator.status.unit_states import SLOTS, each_state, each_state_now
from gateway.operator.status.unit_status import ago_ms, image_status, mirror_status, moved, unit_status, virtual_status
from gateway.operator.units.units import picture
from gateway.readconfig.expiry import certificates
from gateway.runtime.gateway import Gateway, Listener, Owner

if TYPE_CHECKING:
    from gateway.runtime.running import Running


#: How old the status may be over HTTP, in seconds: any number of readers costs no more than one.
KEPT: Final = 1.0


async def tell_status(operator: Operator, _asked: Nothing, asker: Asker) -> Status:
    """Return the status: the present one at the control socket, one of less than a second ago over HTTP."""
    return await (_with_troubles(operator) if asker.door == "control" else recent_status(operator))


class _Last:
    """The last status that was made."""

    def __init__(self) -> None:
        self.status: Status | None = None
        self.one_at_a_time = asyncio.Lock()


async def recent_status(operator: Operator) -> Status:
    """Return the status of now, or the same object again for less than a second."""
    last = operator.kept(_Last)
    async with last.one_at_a_time:
        now = asyncio.get_running_loop().time()
        if last.status is None or now - last.status.at >= KEPT:
            last.status = await _with_troubles(operator)
        return last.status


async def _with_troubles(operator: Operator) -> Status:
    """Make the status and find what is wrong in it; without a history, what is wrong with units at this moment."""
    whole = await status_in_slices(operator.running)
    if operator.history is None:
        found = each_state_now(whole.units)
    else:
        found = each_state(whole.units, operator.history.last(operator.clock(), SLOTS))
    states = dict(await in_slices(found))
    is_rejected = not operator.running.reload_succeeded
    return replace(whole, troubles=tuple(troubles(whole, states, is_rejected=is_rejected)))


async def status_in_slices(running: "Running") -> Status:
    """Make the status, with pauses for the lines: each unit is shown as it was in its turn."""
    gateway, recent = running.gateway, running.recent
    clock = asyncio.get_running_loop().time
    units = await in_slices(unit_status(owner, device, clock()) for owner, device in _devices(gateway))
    lines = await in_slices(line_status(each, recent, clock()) for each in gateway.lines)
    virtual = [await virtual_status(each.unit) for each in gateway.virtual]
    now = clock()
    return Status(
        at=now,
        site=gateway.plan.site,
        page=running.page,
        listeners=tuple(_listener(each) for each in gateway.listeners),
        clients=tuple(each for listener in gateway.listeners for each in _clients(listener, now)),
        rejections=tuple(each for listener in gateway.listeners for each in _rejections(listener, now)),
        lines=tuple(lines),
        servers=tuple(server_status(each) for each in gateway.servers),
        upstreams=tuple(upstream_status(each, recent, now) for each in gateway.upstreams),
        monitors=tuple(monitor_status(each, recent, now) for each in gateway.monitors),
        units=tuple(units),
        images=tuple(image_status(each, now) for each in gateway.images),
        mirrors=tuple(mirror_status(each.unit, now) for each in gateway.mirrors),
        virtual=tuple(virtual),
        certificates=tuple(certificates(running.contexts, time.time())),
        leases=tuple(leases(gateway.lines)),
        moved=tuple(moved(gateway.lines)),
        state_files=() if running.troubles is None else running.troubles.status(),
        **_of_add_ons(running),
    )


async def tell_lines(operator: Operator, asked: Nothing, asker: Asker) -> Lines:
    """Return all lines and upstreams."""
    status = await tell_status(operator, asked, asker)
    return Lines(status.lines, status.servers, status.upstreams, status.monitors)


async def tell_line(operator: Operator, asked: OneLine, asker: Asker) -> AnyLine:
    """Return the line or upstream of this name.

    Raises:
        WrongQuestion: there is none of this name.
    """
    status = await tell_status(operator, Nothing(), asker)
    found = next((each for each in status.all_lines if each.name == asked.name), None)
    if found is not None:
        return found
    raise WrongQuestion(f"there is no line {asked.name}")


async def tell_unit_with_status(operator: Operator, asked: OneUnit, _asker: Asker) -> UnitWithStatus:
    """Describe the unit with this number or name, and how it is doing.

    Raises:
        WrongQuestion: there is none.
    """
    found = picture(operator, asked.unit)
    status = await part_of_unit(operator.gateway, found.unit, found.name)
    return UnitWithStatus(**fields_of(found), status=status)


async def part_of_unit(
    gateway: Gateway, unit: int | None, name: str
) -> UnitStatus | ImageStatus | MirrorStatus | VirtualStatus | None:
    """Make the part of the status about one unit; None if there is none."""
    now = asyncio.get_running_loop().time()
    for owner, device in _devices(gateway):
        if (device.settings.client_unit, device.settings.name) == (unit, name):
            return unit_status(owner, device, now)
    for driver in gateway.virtual:
        if driver.name == name:
            return await virtual_status(driver.unit)
    parts: tuple[ImageStatus | MirrorStatus, ...]
    parts = (
        *(image_status(each, now) for each in gateway.images),
        *(mirror_status(each.unit, now) for each in gateway.mirrors),
    )
    return next((each for each in parts if (each.unit, each.name) == (unit, name)), None)


def _of_add_ons(running: "Running") -> dict[str, Any]:
    """Collect the state of each add-on by its field of the status; empty if it is not configured."""
    told = ((each.shown_as, each.status()) for each in running.add_ons)
    return {field: () if one is None else (one,) for field, one in told}


def _devices(gateway: Gateway) -> list[tuple[Owner, Device]]:
    return [(owner, device) for owner in gateway.owners for device in owner.all_devices]


def _listener(listener: Listener) -> ListenerStatus:
    return ListenerStatus(
        name=listener.settings.name,
        address=listener.address,
        clients=listener.clients,
        accepted=listener.counts.accepted,
        rejected=listener.counts.rejected,
        denied=listener.router.counts.denied,
        no_route=listener.router.counts.no_route,
        most=listener.settings.clients,
    )


def _clients(listener: Listener, now: float) -> Iterator[ClientStatus]:
    for each in listener.connected_clients:
        yield ClientStatus(
            each.caller.client, listener.settings.name, ago_ms(each.last_asked, now), each.asked, each.in_progress
        )


def _rejections(listener: Listener, now: float) -> Iterator[RejectionStatus]:
    for host, each in reversed(listener.counts.rejections.items()):
        yield RejectionStatus(host, listener.settings.name, each.count, milliseconds(now - each.at), each.reason)
