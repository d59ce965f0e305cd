"""What `read` and `write` have in common: find the unit, open it through the gateway or directly, and ask it."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Literal

from gateway.cli.kit.daemon import NOT_UNDERSTOOD, Conversation, which_gateway
from gateway.cli.kit.usage import WrongUsageError
from gateway.cli.units.mbpoll import refuse_habits
from gateway.cli.units.unit import DaemonUnit, Unit
from gateway.cli.units.words import Command
from gateway.errors import GatewayError
from gateway.modbus.functions import only_reads
from gateway.operator.values.steps import Outcome, Steps

Verb = Literal["read", "write"]
#: What a verb does with a unit and the words behind it. Returns the exit code.
Act = Callable[[Unit, Command, Sequence[str]], int]


def run_on_unit(verb: Verb, args: argparse.Namespace, act: Act) -> int:
    """Open the unit that the first word names, and `act` on it; 2, with what to type instead, if that is not clear.

    Raises:
        GatewayError: the unit cannot be asked.
    """
    refuse_habits(verb, args)
    if not args.words:
        raise WrongUsageError("which unit? It is missing", f"modbus-gateway {verb} UNIT; status lists the units")
    wanted, *words = args.words
    with _open_unit(wanted, args) as unit:
        return act(unit, Command(verb, wanted, unit.points, args.swap, unit.wide, unit.is_virtual), words)


@contextmanager
def _open_unit(wanted: str, args: argparse.Namespace) -> Iterator[Unit]:
    """Open the unit with this number or name, in the way that the arguments name.

    Raises:
        DaemonError: the gateway cannot be reached, or has no such unit.
        DirectError, PortError: the port or the server cannot be reached.
        WrongUsageError: the arguments do not fit together.
    """
    if args.port and args.tcp:
        raise WrongUsageError("--port and --tcp are two ways to the unit", "leave one of them out")
    if args.tcp and (args.control or args.config):
        raise WrongUsageError("--tcp asks a server, not a gateway's control socket", "leave out --control and --config")
    if args.port or args.tcp:
        from gateway.cli.units.direct import open_directly  # noqa: PLC0415 - pymodbus takes a quarter of a second

        with open_directly(wanted, args) as unit:
            yield unit
        return
    if args.profile:
        raise WrongUsageError("--profile is for --port and --tcp; the gateway knows what its units are", "leave it out")
    with Conversation(which_gateway(args)) as daemon:
        yield DaemonUnit(daemon, wanted)


def carry_out(unit: Unit, steps: Steps) -> Outcome:
    """Send each request, and give the answer to the next step. An error says what became of a write.

    Raises:
        DaemonError, NoResponseError: there is no response.
        DoesNotFit: a value does not fit with the scale that was read before, or there is none.
    """
    became = ""
    try:
        step = next(steps)
        while True:
            is_write = not only_reads(step.pdu)
            became = "the write may have been carried out" if is_write else became
            answer = unit.ask(step)
            became = "the write was carried out" if is_write else became
            step = steps.send(answer)
    except StopIteration as end:
        outcome: Outcome = end.value
        return outcome
    except (GatewayError, *NOT_UNDERSTOOD) as error:
        if became:
            error.add_note(became)
        raise
