"""A scan of a port that no gateway has open, with a line of our own on it."""

import argparse
from collections.abc import Callable
from contextlib import aclosing
from pathlib import Path

from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.units.device_server import port_to_ask
from gateway.config.machine.known_kinds import known_kinds
from gateway.config.values.address import Address
from gateway.errors import PortError
from gateway.modbus.codes import BROADCAST_UNIT, FIRST_UNIT, LAST_UNIT
from gateway.operator.operations.answers.scan import Found, Progress, ScanStep
from gateway.ports.opener import make_opener
from gateway.ports.port import PortSettings, SerialSettings, TcpSettings
from gateway.runtime.gateway_line import GatewayLine
from gateway.timing.budget import NETWORK_LATENCY
from gateway.timing.characters import LineTiming
from gateway.tools.scan import Scan, Steps, opened, scan_speeds
from gateway.tools.unused_port import unused_line

#: Is told how far a scan is.
Tell = Callable[[Progress], None]


async def scan_port(args: argparse.Namespace, wanted: list[str] | None, tell: Tell) -> ScanStep:
    """Scan the port that the arguments name: all units by default, and in RTU a lone device at address 0.

    Raises:
        WrongUsageError: an argument cannot be meant.
        PortError: the port cannot be opened, or is that of a line of the running gateway.
        WrongQuestion: it was lost.
    """
    line = _line(args)
    everybody = range(BROADCAST_UNIT if line.plan.line.timing.mode == "rtu" else FIRST_UNIT, LAST_UNIT + 1)
    units = list(everybody) if wanted is None else list(map(int, wanted))
    found: tuple[Found, ...] = ()
    try:
        async with aclosing(_steps(line, units, args)) as steps:
            async for step in steps:
                if isinstance(step, Progress):
                    tell(step)
                else:
                    found = step
    except PortError as error:
        raise _with_remedy(error, args.port) from error
    return ScanStep(found=found, asked=len(units))


def _with_remedy(error: PortError, port: str) -> PortError:
    remedy = "if a gateway has this port, leave out --port and name its line"
    return PortError(f"{error}\n  help: {remedy}") if Path(port).exists() else error


async def _steps(line: GatewayLine, units: list[int], args: argparse.Namespace) -> Steps:
    kinds = known_kinds(Path(args.config) if args.config else None)
    if args.all_speeds:
        async with aclosing(scan_speeds(line.at_speed, units, args.timeout, kinds)) as steps:
            async for step in steps:
                yield step
        return
    async with opened(line), aclosing(Scan(line, units, args.timeout, kinds).run()) as steps:
        async for step in steps:
            yield step


def _line(args: argparse.Namespace) -> GatewayLine:
    port, format_, mode = port_to_ask(args, args.mode or "rtu")
    settings: PortSettings
    if isinstance(port, Address):
        if args.all_speeds:
            raise WrongUsageError("the rate of a port behind a device server is set there", "leave out --all-speeds")
        settings = TcpSettings(str(port), port.host, port.port, NETWORK_LATENCY)
    else:
        settings = SerialSettings(port, args.baud, format_)
    return unused_line(settings, LineTiming(mode, args.baud, format_), make_opener)
