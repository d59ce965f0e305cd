"""Ports that are asked without a gateway. A device server cannot tell whose response it carries."""

import argparse
import socket
import time
from contextlib import suppress
from dataclasses import dataclass
from select import select
from typing import Final

from gateway.cli.kit.daemon import Conversation, Meant, which_gateway
from gateway.cli.kit.usage import WrongUsageError
from gateway.config.problem import WrongValue
from gateway.config.values.address import Address
from gateway.config.values.port import (
    DEFAULT_FORMATS,
    DEVICE_SERVER_MODES,
    fits_mode,
    parse_format,
    parse_line_port,
    parse_port,
)
from gateway.control.path import SYSTEM_SOCKET
from gateway.errors import DaemonError, PortError
from gateway.operator.operations.operation import Nothing
from gateway.operator.operations.results import read_result
from gateway.operator.operations.table import STATUS
from gateway.ports.port import CLOSED_AT_ONCE
from gateway.ports.tcp import READ_SIZE
from gateway.timing.budget import NETWORK_LATENCY
from gateway.timing.characters import CharacterFormat, Mode

_TAKEN: Final = (
    "{port} is the port of line {line} of the running gateway ({gateway})\n  help: leave out --port to go through it"
)


@dataclass(frozen=True, slots=True)
class _Line:
    name: str
    port: str


@dataclass(frozen=True, slots=True)
class _Lines:
    """What is needed of a status here: a gateway of any version tells it."""

    lines: tuple[_Line, ...]
    servers: tuple[_Line, ...]


def port_to_ask(args: argparse.Namespace, mode: Mode) -> tuple[str | Address, CharacterFormat, Mode]:
    """Read the port that arguments name, its format, and its mode: this one, unless it is that of a device server.

    Raises:
        WrongUsageError: one of them is wrong.
        PortError: it is the port of a line of a running gateway.
    """
    try:
        port = parse_port(args.port)
        mode = DEVICE_SERVER_MODES[port.scheme] if isinstance(port, Address) else mode
        format_ = DEFAULT_FORMATS[mode] if args.format is None else parse_format(args.format)
    except WrongValue as wrong:
        raise WrongUsageError(str(wrong), wrong.remedy) from wrong
    if not fits_mode(format_, mode):
        raise WrongUsageError(f"RTU needs 8 data bits, and {format_} has {format_.data_bits}", "is it --mode ascii?")
    if isinstance(port, Address):
        _refuse_port_of_gateway(port, which_gateway(args))
    return port, format_, mode


def _refuse_port_of_gateway(port: Address, gateway: Meant) -> None:
    """Refuse a device server that this gateway or that of the system asks: two clients get each other's responses.

    Both only say which lines they have.

    Raises:
        PortError: it is the port of a line.
    """
    for each in {gateway, Meant(SYSTEM_SOCKET)}:
        with suppress(DaemonError), Conversation(each) as daemon:  # no gateway that answers, no line of it
            lines = read_result(_Lines, daemon.ask_for_json(STATUS, Nothing()).get("status"))
            for line in (*lines.lines, *lines.servers):
                taken = parse_line_port(line.port)
                if isinstance(taken, Address) and taken.collides_with(port):
                    raise PortError(_TAKEN.format(port=port, line=line.name, gateway=each.socket))


def settle(connection: socket.socket, port: str) -> None:
    """Wait for the latency of a new connection, as a line does. What comes meanwhile is dropped.

    Raises:
        PortError: the device server has closed the connection again.
    """
    end = time.monotonic() + NETWORK_LATENCY
    with suppress(ConnectionError):
        while select([connection], [], [], max(0.0, end - time.monotonic()))[0]:
            if not connection.recv(READ_SIZE):
                break
            if time.monotonic() >= end:
                return  # it may send without end
        else:
            return
    raise PortError(CLOSED_AT_ONCE.format(port=port))
