"""Units as clients see them, and finding them by number or name."""

from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import islice, takewhile
from typing import Final, NamedTuple

from gateway.config.plan.settings import Plan
from gateway.config.problem import did_you_mean
from gateway.errors import WrongQuestion
from gateway.images.image import ImageSettings
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT, Area, FunctionCode
from gateway.modbus.pdu import Span
from gateway.operator.operations.answers.unit import DEVICES, UnitHead, UnitPicture, Units
from gateway.operator.operations.asked import OneUnit
from gateway.operator.operations.operation import Asker, Nothing
from gateway.operator.operator import Operator, until_reload
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile
from gateway.profiles.read_rules import ReadRules
from gateway.runtime.gateway import Gateway
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.running import Running

#: No point takes more registers: one request reads it.
_LONGEST_POINT: Final = 125
_HEAD: Final = tuple(field.name for field in fields(UnitHead))


async def tell_units(operator: Operator, _asked: Nothing, _asker: Asker) -> Units:
    """Describe every unit, without its points."""
    return Units(tuple(UnitHead(**{name: getattr(each, name) for name in _HEAD}) for each in units_of(operator)))


async def tell_unit(operator: Operator, asked: OneUnit, _asker: Asker) -> UnitPicture:
    """Describe the unit with this number or name.

    Raises:
        WrongQuestion: there is none.
    """
    return picture(operator, asked.unit)


@until_reload
def units_of(operator: Operator) -> tuple[UnitPicture, ...]:
    """Describe every unit, by number; those without one come last, in the order of the config."""
    gateway = operator.gateway
    longest, units = gateway.longest_waits, sorted(_units(gateway.plan), key=lambda one: min(one.key, HIGHEST_UNIT + 1))
    return tuple(_picture(each, gateway, longest) for each in units)


def picture(operator: Operator, wanted: int | str) -> UnitPicture:
    """Describe the unit with this number or name; made once until a reload.

    Raises:
        WrongQuestion: there is none.
    """
    known, gateway = _pictured(operator), operator.gateway
    if wanted not in known:
        key = find_unit(gateway.plan, wanted)
        found = next((each for each in _units(gateway.plan) if each.key == key), None)
        if found is None:
            where = _who_has_it(gateway.plan)
            raise WrongQuestion(f"there is no unit {key}{where}; modbus-gateway check lists the units")
        known[wanted] = _picture(found, gateway, gateway.longest_waits)
    return known[wanted]


@until_reload
def _pictured(_operator: Operator) -> dict[int | str, UnitPicture]:
    """Make what `picture` remembers, by what was asked for."""
    return {}


def points_within(operator: Operator, unit: UnitPicture, span: Span) -> Sequence[Point]:
    """List the points of a unit with an address in `span`, in their order, without a look at all others."""
    placed = _placed(operator)
    if unit.key not in placed or placed[unit.key][0] is not unit.points:  # a reload may come amid the work of a reader
        areas: dict[Area, list[Point]] = {area: [] for area in Area}
        for point in sorted(unit.points, key=lambda each: each.address):
            areas[point.area].append(point)
        placed[unit.key] = unit.points, areas
    points = placed[unit.key][1][span.area]
    first = bisect_left(points, span.start - _LONGEST_POINT, key=lambda each: each.address)
    near = takewhile(lambda each: each.address < span.end, islice(points, first, None))
    return [point for point in near if point.span.end > span.start]


@until_reload
def _placed(_operator: Operator) -> dict[int, tuple[Sequence[Point], dict[Area, list[Point]]]]:
    """Make what `points_within` remembers: points, and the same in the order of their addresses, by unit and area."""
    return {}


def find_unit(plan: Plan, wanted: object) -> int:
    """Find the number of the unit with this number or name; above all units if it has none, see `key_of`.

    Raises:
        WrongQuestion: nothing has this name, or it is not a unit number.
    """
    if isinstance(wanted, int) and not isinstance(wanted, bool) and 0 <= wanted <= 255:
        return wanted
    if not isinstance(wanted, str):
        raise WrongQuestion('"unit" must be a number from 0 to 255, or a name')
    key = next((each.key for each in _units(plan) if each.name == wanted), None)
    if key is None:
        number = f"a number is written without quotes: {wanted}" if wanted.isdecimal() else ""
        remedy = number or did_you_mean(wanted, (each.name for each in _units(plan)))
        raise WrongQuestion(f'nothing has the name "{wanted}"' + (f"; {remedy}" if remedy else ""))
    return key


def shown_unit(key: int) -> int | None:
    """Return the number that clients use, of one that `find_unit` has found; None if they use none."""
    return key if key <= HIGHEST_UNIT else None


def _who_has_it(plan: Plan) -> str:
    """Say where a number may be one, if listeners lead to a single line or upstream: commands do not know by which."""
    if not any(listener.only for listener in plan.listeners):
        return ""
    return " that all clients can reach; one behind a listener of its own has a name, or --tcp with that address"


def find_line(gateway: Gateway, wanted: object) -> GatewayLine:
    """Find the client line of this name.

    Raises:
        WrongQuestion: there is none.
    """
    line = next((each for each in gateway.lines if each.name == wanted), None)
    if line is not None:
        return line
    if any(wanted == upstream.name for upstream in gateway.upstreams):
        raise WrongQuestion(f"{wanted} is a connection to another server: that is for lines only")
    if any(wanted == server.name for server in gateway.servers):
        raise WrongQuestion(f"on {wanted} the gateway is a server: an outside client asks there")
    if any(wanted == monitor.name for monitor in gateway.monitors):
        raise WrongQuestion(f"on {wanted} the gateway only listens: nothing is ever sent there")
    raise no_such_line(wanted, (each.name for each in gateway.lines))


def no_such_line(wanted: object, known: Iterable[str]) -> WrongQuestion:
    """Make the error that none of the `known` lines has this name."""
    remedy = did_you_mean(str(wanted), known)
    return WrongQuestion(f'there is no line "{wanted}"' + (f"; {remedy}" if remedy else ""))


def may_read_all(running: Running) -> bool:
    """Return whether an operator may read every unit: a search for devices asks unknown numbers."""
    rights, function = running.routers.control.rights, FunctionCode.READ_HOLDING_REGISTERS
    return all(function in rights.everywhere("", unit) for unit in range(FIRST_UNIT, HIGHEST_UNIT + 1))


def names(plan: Plan) -> dict[int, str]:
    """Return the names of the units by number, or by what stands in its place."""
    return {each.key: each.name for each in _units(plan)}


class _Unit(NamedTuple):
    key: int
    name: str
    kind: str
    profile: Profile


def _units(plan: Plan) -> Iterator[_Unit]:
    """Yield all units except those that are reached only by a listener for their line or upstream."""
    for line in plan.lines:
        yield from (_Unit(each.known_as, each.name, "device", each.profile) for each in line.shared)
    for upstream in plan.upstreams:
        yield from (_Unit(each.known_as, each.name, "upstream", each.profile) for each in upstream.devices)
    for monitor in plan.monitors:
        yield from (_Unit(each.known_as, each.name, "heard", each.profile) for each in monitor.devices)
    yield from (_Unit(image.unit, image.name, _kind(image), image.profile) for image in plan.images)
    yield from (_Unit(mirror.unit, mirror.name, "mirror", mirror.profile) for mirror in plan.mirrors)
    yield from (_Unit(virtual.unit, virtual.name, "virtual", virtual.profile) for virtual in plan.virtual)


def _kind(image: ImageSettings) -> str:
    return "gateway" if image.shows_gateway else "custom" if image.python else "image"


def _picture(found: _Unit, gateway: Gateway, longest: Mapping[str, float]) -> UnitPicture:
    functions = found.profile.functions
    wide = found.profile.wide if found.kind in DEVICES else {}
    return UnitPicture(
        unit=shown_unit(found.key),
        name=found.name,
        kind=found.kind,
        profile=found.profile.name,
        functions=None if functions is None else tuple(sorted(functions)),
        limits=found.profile.limits,
        areas={str(area): ranges for area, ranges in found.profile.areas.items()},
        longest_wait_ms=round(longest.get(found.name, 0.0) * 1000, 1),
        wide={str(area): ranges for area, ranges in wide.items()},
        max_gap=ReadRules.of(found.profile).max_gap if found.kind in DEVICES else 0,
        points=gateway.plan.points.get(found.key, ()),
    )
