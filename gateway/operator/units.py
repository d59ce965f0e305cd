"""What an operator asks of units, at the control socket or over HTTP: requests, and what a unit is."""

import asyncio
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from gateway.config.plan.plan import Plan
from gateway.config.problem import did_you_mean
from gateway.config.reserved import CONTROL
from gateway.errors import LineDown, RequestError, WrongQuestion
from gateway.images.image import ImageSettings
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT, MAX_PDU, FunctionCode
from gateway.modbus.functions import only_reads
from gateway.operator.frames import frames_of
from gateway.ports.port import SiteSettings
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range
from gateway.request import Caller, Request
from gateway.routing.router import Router
from gateway.runtime.build import Gateway
from gateway.runtime.parts import GatewayLine, GatewayUpstream


@dataclass(frozen=True, slots=True)
class UnitPicture:
    """A unit for clients: what answers for it, what it accepts, and its points.

    A response takes `longest_wait_ms` at most; 0 for a unit that the gateway answers itself.
    """

    unit: int
    name: str
    kind: str
    profile: str
    functions: tuple[int, ...] | None
    limits: Mapping[int, int]
    areas: Mapping[str, tuple[Range, ...]]
    longest_wait_ms: float
    points: tuple[Point, ...]


#: Whether who asks is still there.
IsThere = Callable[[], bool]

#: The operators at the control socket.
AT_CONTROL: Final = Caller.without_address(CONTROL)


class AwaitedOrigin:
    """The Origin of one request of an operator. `outcome` is its error, if any, and its response."""

    def __init__(self, is_there: Callable[[], bool], caller: Caller = AT_CONTROL) -> None:
        """`is_there` tells whether the operator is still connected."""
        self.caller = caller
        self.outcome: asyncio.Future[tuple[RequestError | None, bytes | None]] = (
            asyncio.get_running_loop().create_future()
        )
        self._is_there = is_there

    def wants(self, request: Request) -> bool:
        """Whether the request should still be sent: only while the client is connected."""
        return not self.outcome.done() and (only_reads(request.pdu) or self._is_there())

    def answer(self, request: Request, pdu: bytes | None) -> None:
        """Take the response."""
        if not self.outcome.done():
            self.outcome.set_result((request.error, pdu))


class Done(NamedTuple):
    """What became of a request: its response, its start, how long it took, and the gateway's error if there is one."""

    pdu: bytes | None
    started: float
    elapsed_ms: float
    error: RequestError | None


async def ask(gateway: Gateway, question: Mapping[str, Any], is_there: Callable[[], bool]) -> dict[str, Any]:
    """Send a request like one of any client, with rights, queue and limits: `unit` (number or name) and `pdu` (hex).

    The answer has the response PDU; for an exception from the gateway itself, `result` and `reason` say why.
    `sent` and `received` are the frames on the line, if there were any.

    Raises:
        WrongQuestion: there is no such unit, or `pdu` is not a PDU.
    """
    unit, pdu = find_unit(gateway.plan, question.get("unit")), _pdu(question.get("pdu"))
    done = await send(gateway.control, unit, pdu, AwaitedOrigin(is_there))
    answer = {
        "unit": unit,
        "pdu": None if done.pdu is None else done.pdu.hex(" ").upper(),
        "elapsed_ms": done.elapsed_ms,
    }
    answer |= frames_of(gateway, CONTROL, pdu, done.started)
    if done.error is None:
        return answer
    reason = _missing_site(gateway, unit) if isinstance(done.error, LineDown) else str(done.error)
    return {**answer, "result": done.error.result, "reason": reason}


def _missing_site(gateway: Gateway, unit: int) -> str:
    """Why the site that has a unit cannot be reached; empty if it can, or if the unit is of this site."""
    for upstream in gateway.upstreams:
        trouble = upstream.reconnector.error
        if unit in upstream.devices and trouble is not None and isinstance(upstream.plan.port, SiteSettings):
            return f"{trouble}; modbus-gateway status --fleet shows the sites"
    return ""


async def send(router: Router, unit: int, pdu: bytes, question: AwaitedOrigin) -> Done:
    """Send a request through `router`, and wait for what becomes of it."""
    now = asyncio.get_running_loop().time
    started = now()
    router.submit(Request(unit, pdu, question, started), started)
    error, response = await question.outcome
    return Done(response, started, round((now() - started) * 1000, 1), error)


def picture(gateway: Gateway, wanted: object) -> UnitPicture:
    """Describe the unit with this number or name.

    Raises:
        WrongQuestion: there is none.
    """
    unit = find_unit(gateway.plan, wanted)
    found = next((each for each in _units(gateway.plan) if each.unit == unit), None)
    if found is None:
        raise WrongQuestion(f"there is no unit {unit}; modbus-gateway check lists the units")
    return _picture(found, gateway, _longest_waits(gateway))


def pictures(gateway: Gateway) -> tuple[UnitPicture, ...]:
    """Every unit, by its number."""
    longest = _longest_waits(gateway)
    return tuple(_picture(each, gateway, longest) for each in sorted(_units(gateway.plan), key=lambda one: one.unit))


def find_unit(plan: Plan, wanted: object) -> int:
    """Find the number of a unit that is named by number or name.

    Raises:
        WrongQuestion: nothing has this name, or it is not a unit number.
    """
    if isinstance(wanted, int) and not isinstance(wanted, bool) and 0 <= wanted <= 255:
        return wanted
    if not isinstance(wanted, str):
        raise WrongQuestion('"unit" must be a number from 0 to 255, or a name')
    unit = next((each.unit for each in _units(plan) if each.name == wanted), None)
    if unit is None:
        remedy = did_you_mean(wanted, (each.name for each in _units(plan)))
        raise WrongQuestion(f'nothing has the name "{wanted}"' + (f"; {remedy}" if remedy else ""))
    return unit


def find_line(gateway: Gateway, wanted: object) -> GatewayLine:
    """Find the client line of this name.

    Raises:
        WrongQuestion: there is none.
    """
    line = next((each for each in gateway.lines if each.name == wanted), None)
    if line is not None:
        return line
    if any(wanted == server.name for server in gateway.servers):
        raise WrongQuestion(f"on {wanted} the gateway is a server: an outside client asks there")
    raise no_such_line(wanted, (each.name for each in gateway.lines))


def no_such_line(wanted: object, known: Iterable[str]) -> WrongQuestion:
    """That none of the `known` lines has this name."""
    remedy = did_you_mean(str(wanted), known)
    return WrongQuestion(f'there is no line "{wanted}"' + (f"; {remedy}" if remedy else ""))


def may_read_all(gateway: Gateway) -> bool:
    """Whether an operator may read every unit: who looks for a device asks numbers of which he knows nothing."""
    rights = gateway.control.rights[""]
    return all(FunctionCode.READ_HOLDING_REGISTERS in rights[unit] for unit in range(FIRST_UNIT, HIGHEST_UNIT + 1))


def names(plan: Plan) -> dict[int, str]:
    """What the units are called."""
    return {each.unit: each.name for each in _units(plan)}


class _Unit(NamedTuple):
    unit: int
    name: str
    kind: str
    profile: Profile


def _units(plan: Plan) -> Iterator[_Unit]:
    """All units except those that only a listener for their line or upstream leads to."""
    for line in plan.lines:
        yield from (_Unit(each.known_as, each.name, "device", each.profile) for each in line.shared)
    for upstream in plan.upstreams:
        yield from (_Unit(each.known_as, each.name, "upstream", each.profile) for each in upstream.devices)
    yield from (_Unit(image.unit, image.name, _kind(image), image.profile) for image in plan.images)
    yield from (_Unit(mirror.unit, mirror.name, "mirror", mirror.profile) for mirror in plan.mirrors)


def _kind(image: ImageSettings) -> str:
    return "gateway" if image.shows_gateway else "image"


def _longest_waits(gateway: Gateway) -> Mapping[str, float]:
    """The longest wait for each unit that is not in the gateway, in seconds."""
    parts: tuple[GatewayLine | GatewayUpstream, ...] = (*gateway.lines, *gateway.upstreams)
    return {name: wait for part in parts for name, wait in part.longest_wait.items()}


def _picture(found: _Unit, gateway: Gateway, longest: Mapping[str, float]) -> UnitPicture:
    functions = found.profile.functions
    return UnitPicture(
        unit=found.unit,
        name=found.name,
        kind=found.kind,
        profile=found.profile.name,
        functions=None if functions is None else tuple(sorted(functions)),
        limits=found.profile.limits,
        areas={str(area): ranges for area, ranges in found.profile.areas.items()},
        longest_wait_ms=round(longest.get(found.name, 0.0) * 1000, 1),
        points=gateway.plan.points.get(found.unit, ()),
    )


def _pdu(text: object) -> bytes:
    try:
        pdu = bytes.fromhex(text) if isinstance(text, str) else b""
    except ValueError:
        pdu = b""
    if not 1 <= len(pdu) <= MAX_PDU:
        raise WrongQuestion(f'"pdu" must be 1 to {MAX_PDU} bytes in hexadecimal, such as "03 00 00 00 02"')
    return pdu
