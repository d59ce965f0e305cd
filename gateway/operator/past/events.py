"""The operation `events`: what has happened, also in earlier runs of this gateway."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from gateway.clock.slices import in_slices
from gateway.clock.times import rfc_3339
from gateway.config.plan.settings import Plan
from gateway.errors import WrongQuestion
from gateway.events import Level
from gateway.observe.fan_out import BYTES
from gateway.observe.last_events import LastEvent
from gateway.operator.operations.answers.events import Happened, Told
from gateway.operator.operations.asked import ToList
from gateway.operator.operations.operation import Asker
from gateway.operator.operator import Operator
from gateway.operator.trace.reader import may_see_all
from gateway.operator.units.units import find_unit, names, no_such_line
from gateway.runtime.gateway import Gateway

Test = Callable[[Mapping[str, Any]], bool]


async def tell_events(operator: Operator, asked: ToList, asker: Asker) -> Happened:
    """Return the last events that are `asked` for.

    Raises:
        WrongQuestion: there is no such line or unit, and no event of one.
    """
    changed = operator.events.changed
    if asked.after == changed:
        return Happened((), changed)
    sees_bytes = asker.door == "control" or may_see_all(operator.running, asker.host)
    found = last_events(operator, asked)
    return Happened(await in_slices(told(each, sees_bytes=sees_bytes) for each in found), changed)


def last_events(operator: Operator, asked: ToList) -> list[LastEvent]:
    """List the last events that are `asked` for, oldest first.

    Raises:
        WrongQuestion: there is no such line or unit, and no event of one.
    """
    since = 0.0 if asked.since is None else operator.clock() - asked.since
    least, after = Level[asked.level.upper()], -1 if asked.after is None else asked.after
    if after > operator.events.changed:  # a number from before a restart: all events may be new
        after = -1
    every = operator.events.all()
    tests = list(_tests(operator.gateway, asked, every))
    found = [
        each
        for each in every
        if each.last_at >= since
        and each.level >= least
        and each.changed > after
        and all(test(each.fields) for test in tests)
    ]
    return found if asked.count is None else found[-asked.count :]


def told(event: LastEvent, *, sees_bytes: bool) -> Told:
    """Make the JSON object of an event; bytes of a line only for those who may see them."""
    return {
        **event.fields,
        **({} if sees_bytes else {name: None for name in BYTES if name in event.fields}),
        "timestamp": rfc_3339(event.last_at),
        "event": event.name,
        "level": Level(event.level).name.lower(),
        "text": event.text,
        "times": event.times,
        "since": rfc_3339(event.first_at),
        "number": event.number,
    }


def _tests(gateway: Gateway, asked: ToList, events: Iterable[LastEvent]) -> Iterable[Test]:
    if asked.line is not None:
        yield _of_line(gateway, asked.line, events)
    if asked.unit is not None:
        yield _of_unit(gateway.plan, asked.unit, events)
    if asked.client is not None:
        yield _of_client(asked.client)


def _of_line(gateway: Gateway, line: str, events: Iterable[LastEvent]) -> Test:
    """Make the test for events of a line, server line or upstream, and of clients that asked its units."""
    known = [part.name for part in gateway.parts]
    if line not in known and not any(each.fields.get("line") == line for each in events):
        raise no_such_line(line, known)
    devices = [device for owner in gateway.owners if owner.name == line for device in owner.all_devices]
    of_line = {device.name for device in devices}
    units = {device.settings.client_unit for device in devices} - {None}

    def is_of_it(fields: Mapping[str, Any]) -> bool:
        if fields.get("line") or fields.get("device"):
            return fields.get("line") == line or fields.get("device") in of_line
        return "client" in fields and fields.get("unit") in units

    return is_of_it


def _of_unit(plan: Plan, unit: int | str, events: Iterable[LastEvent]) -> Test:
    """Make the test for events of a unit: by its name, or by the number that clients use."""
    try:
        number = find_unit(plan, unit)
    except WrongQuestion:
        if not any(unit in (each.fields.get("device"), each.fields.get("image")) for each in events):
            raise
        number = None
    name = unit if number is None else names(plan).get(number)

    def is_of_it(fields: Mapping[str, Any]) -> bool:
        if name is not None and name in (fields.get("device"), fields.get("image")):
            return True
        if number is None or fields.get("unit") != number:
            return False
        return name is None or ("client" in fields and not (fields.get("line") or fields.get("device")))

    return is_of_it


def _of_client(client: str) -> Test:
    """Make the test for events of a client: by its address, with the port or without it, or by a user's name."""

    def is_of_it(fields: Mapping[str, Any]) -> bool:
        one = str(fields.get("client", ""))
        host = one.rpartition(":")[0].strip("[]")
        return client in (one, host, one.rpartition("@")[2], fields.get("user"))

    return is_of_it
