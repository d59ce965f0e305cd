"""Direct access to a unit without a gateway: on a serial port or behind a Modbus TCP server. Uses pymodbus."""

import argparse
import logging
import re
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from socket import socket
from typing import Final, Literal

from pymodbus import FramerType, ModbusException
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.pdu import ModbusPDU

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.profiles.known import BrokenFileError, Profiles
from gateway.cli.units.device_server import port_to_ask, settle
from gateway.cli.units.unit import NoResponseError
from gateway.config.plan.points import points_of
from gateway.config.plan.profiles import profile_of
from gateway.config.problem import WrongValue
from gateway.config.schema.profile import ProfileTable
from gateway.config.values.address import Address, parse_address
from gateway.errors import GatewayError, PortError
from gateway.modbus.codes import FIRST_UNIT, HIGHEST_UNIT
from gateway.modbus.explain import Mode, explain
from gateway.modbus.pdu import RequestPdu, parse_request, parse_wide, spans_of
from gateway.operator.values.steps import Answer, Step
from gateway.ports.opener import open_blocking
from gateway.ports.port import SerialSettings
from gateway.profiles.holes import Holes
from gateway.profiles.point import Point
from gateway.profiles.profile import Range, width_at
from gateway.profiles.read_rules import NO_RULES, ReadRules
from gateway.registers.items import WIDE_REGISTER

#: The usual time limit in seconds, and that of a server: a gateway lets requests wait, and waits for slow devices.
_TIMEOUT: Final = 1.0
_TCP_TIMEOUT: Final = 10.0
_FRAMERS: Final = {"rtu": FramerType.RTU, "ascii": FramerType.ASCII}

_Client = ModbusSerialClient | ModbusTcpClient


class DirectError(GatewayError):
    """A port or server cannot be reached."""


class _RequestPdu(ModbusPDU):
    """A request of these bytes, as they are: pymodbus itself would give each register two bytes."""

    def __init__(self, pdu: bytes, unit: int) -> None:
        super().__init__(dev_id=unit)
        self.function_code = pdu[0]
        self._data = pdu[1:]

    def encode(self) -> bytes:
        """Return the bytes after the function code."""
        return self._data


class DirectUnit:
    """A unit behind a client of pymodbus."""

    name = ""
    gateway: Path | None = None

    def __init__(self, client: _Client, number: int, points: tuple[Point, ...], place: "_Place") -> None:
        self.number = number
        self.points = points
        self.functions = place.functions
        self.limits = place.limits
        self.wide = place.wide
        self.is_virtual = False
        self.read_rules = place.read_rules
        self.holes = Holes()
        self._client = client
        self._frames = place.frames
        self._framing: Mode = "tcp" if place.is_tcp else place.mode
        self._advice = place.advice

    def ask(self, step: Step) -> Answer:
        """Send a request, which is none to be carried out in one turn.

        Raises:
            NoResponseError: no response came, or what came is not the response to this request.
        """
        pdu = step.pdu
        self._frames.clear()
        started = time.monotonic()
        try:
            response = self._client.execute(False, _RequestPdu(pdu, self.number))
            elapsed = time.monotonic() - started
            answer = bytes((response.function_code, *response.encode()))
        except (ModbusException, OSError, ValueError) as wrong:
            raise NoResponseError(f"unit {self.number}: {self._what_came(pdu)}; {self._advice}") from wrong
        if not self._parsed(pdu).accepts(answer):
            came = f"{answer.hex(' ').upper()} ({self._what_came(pdu)})"
            raise NoResponseError(f"unit {self.number}: this is not the response to this request: {came}")
        frames = self._frames
        return Answer(answer, round(elapsed * 1000, 1), sent=frames.get(True, b""), received=frames.get(False, b""))

    def _what_came(self, pdu: bytes) -> str:
        """Say what came in place of the response to this request."""
        came = self._frames.get(False, b"")
        if not came:
            return "no response"
        unknown = "what came is no response" if self._framing == "tcp" else "the response is damaged"
        return explain(self._parsed(pdu), self.number, came, self._framing) or unknown

    def _parsed(self, pdu: bytes) -> RequestPdu:
        """Parse a request; it is for registers of four bytes where the profile says so."""
        is_wide = any(width_at(self.wide, span) == WIDE_REGISTER for span in spans_of(pdu))
        return parse_wide(pdu) if is_wide else parse_request(pdu)


class _Place:
    """Where the unit is, and its profile. `frames` are the last ones sent (True) and received (False)."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.frames: dict[bool, bytes] = {}
        self.functions: frozenset[int] | None = None
        self.limits: Mapping[int, int] = {}
        self.wide: Mapping[str, tuple[Range, ...]] = {}
        self.read_rules = NO_RULES
        self.mode: Literal["rtu", "ascii"] = args.mode or "rtu"
        self.is_tcp = bool(args.tcp)
        self._is_mode_given = args.mode is not None
        self.timeout: float = args.timeout or (_TCP_TIMEOUT if args.tcp else _TIMEOUT)
        seconds = f"{self.timeout:g} s"
        self.advice = f"the limit is {seconds} (--timeout); are unit, wiring, rate and format right?"
        if args.tcp:
            unit_or_tls = "does this server know the unit, and is this port one without TLS? No command speaks TLS"
            self.advice = f"the limit is {seconds} (--timeout); {unit_or_tls}"

    def take(self, kind: ProfileTable) -> tuple[Point, ...]:
        """Keep the profile's functions and what it allows; returns its points."""
        self.functions = None if kind.functions is None else frozenset(kind.functions)
        self.limits, self.wide = kind.limits, {str(area): ranges for area, ranges in kind.wide.items()}
        self.read_rules = ReadRules.of(profile_of("", kind))
        if kind.mode is not None and not self._is_mode_given:
            self.mode = kind.mode
        return points_of(kind.points, kind)

    def trace(self, sending: bool, data: bytes) -> bytes:  # noqa: FBT001 - called by pymodbus
        """Keep the frames that pymodbus sends and receives."""
        self.frames[sending] = data
        return data


@contextmanager
def open_directly(wanted: str, args: argparse.Namespace) -> Iterator[DirectUnit]:
    """Open the unit with this number on the port or behind the server that the arguments name.

    Raises:
        WrongUsageError: an argument is wrong.
        DirectError, PortError: port or server cannot be opened.
    """
    if not wanted.isdecimal():
        raise WrongUsageError(f'"{wanted}" is a name, and only a running gateway knows names', "use the unit number")
    if int(wanted) > HIGHEST_UNIT or (args.port and int(wanted) < FIRST_UNIT):
        raise WrongUsageError(f"{wanted} is not a unit number", f"units are {FIRST_UNIT} to {HIGHEST_UNIT}")
    place = _Place(args)
    points = _points(args.profile, place)
    with ExitStack() as open_parts:
        told = open_parts.enter_context(_collect_pymodbus_log())
        client = (_tcp_client if args.tcp else _port_client)(args, place, open_parts)
        if not client.connect():
            raise DirectError(f"{args.tcp or args.port} cannot be reached: {_reason(told)}")
        if args.port and isinstance(client.socket, socket):
            settle(client.socket, args.port)
        yield DirectUnit(client, int(wanted), points, place)


def _points(profile: str | None, place: _Place) -> tuple[Point, ...]:
    if profile is None:
        return ()
    try:
        return place.take(Profiles().get(profile).table)
    except BrokenFileError as broken:
        raise DirectError("\n".join(map(str, broken.problems))) from None


def _tcp_client(args: argparse.Namespace, place: _Place, open_parts: ExitStack) -> _Client:
    text = args.tcp.removeprefix("tcp://")
    try:
        address = parse_address(f"tcp://{text}", ("tcp",))
    except WrongValue as wrong:
        raise WrongUsageError(f"--tcp {args.tcp}: {wrong}", "write --tcp 10.1.0.5, or --tcp 10.1.0.5:502") from wrong
    return _socket_client(address, FramerType.SOCKET, place, open_parts)


def _socket_client(address: Address, framer: FramerType, place: _Place, open_parts: ExitStack) -> ModbusTcpClient:
    client = ModbusTcpClient(
        address.host,
        port=address.port,
        framer=framer,
        timeout=place.timeout,
        retries=0,
        trace_packet=place.trace,
    )
    open_parts.callback(client.close)
    return client


def _port_client(args: argparse.Namespace, place: _Place, open_parts: ExitStack) -> _Client:
    """Make a client for a device server, or for a serial port, opened in the same way as the gateway does."""
    port, format_, place.mode = port_to_ask(args, place.mode)
    if isinstance(port, Address):
        return _socket_client(port, _FRAMERS[place.mode], place, open_parts)
    try:
        serial = open_parts.enter_context(open_blocking(SerialSettings(port, args.baud, format_), place.timeout))
    except PortError as error:
        remedy = "if a gateway uses this port, leave out --port to go through it"
        raise DirectError(f"{error}\n  help: {remedy}" if Path(port).exists() else str(error)) from error
    client = ModbusSerialClient(
        port,
        framer=_FRAMERS[place.mode],
        baudrate=args.baud,
        bytesize=format_.data_bits,
        parity=format_.parity,
        stopbits=format_.stop_bits,
        timeout=place.timeout,
        retries=0,
        trace_packet=place.trace,
    )
    client.socket = serial
    return client


def _reason(told: list[str]) -> str:
    return re.sub(r"^\[Errno -?\d+\] ", "", told[-1].rpartition("failed: ")[2]) if told else "no reason is known"


@contextmanager
def _collect_pymodbus_log() -> Iterator[list[str]]:
    """Collect what pymodbus logs: it reports reasons nowhere else. Nothing of it is printed."""
    told: list[str] = []
    handler = logging.Handler()
    handler.emit = lambda record: told.append(record.getMessage())  # type: ignore[method-assign]
    log = logging.getLogger("pymodbus")
    before = log.propagate
    log.addHandler(handler)
    log.propagate = False
    try:
        yield told
    finally:
        log.removeHandler(handler)
        log.propagate = before
