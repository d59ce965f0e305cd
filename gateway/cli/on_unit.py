"""How `read` and `write` begin: which unit is meant, and what of it."""

import argparse
from collections.abc import Callable, Sequence
from typing import Literal

from gateway.cli.mbpoll import refuse_habits
from gateway.cli.unit import Unit, open_unit
from gateway.cli.usage import WrongUsageError, tell_wrong_usage
from gateway.cli.words import Command

Verb = Literal["read", "write"]
#: What a verb does with a unit and the words behind it. Returns the exit code.
Act = Callable[[Unit, Command, Sequence[str]], int]


def run_on_unit(verb: Verb, args: argparse.Namespace, act: Act) -> int:
    """Open the unit that the first word names, and `act` on it; 2, with what to type instead, if that is not clear.

    Raises:
        GatewayError: the unit cannot be asked.
    """
    try:
        return _run(verb, args, act)
    except WrongUsageError as wrong:
        return tell_wrong_usage(wrong)


def _run(verb: Verb, args: argparse.Namespace, act: Act) -> int:
    refuse_habits(verb, args)
    if not args.words:
        raise WrongUsageError("which unit? It is missing", f"modbus-gateway {verb} UNIT; status lists the units")
    wanted, *words = args.words
    with open_unit(wanted, args) as unit:
        return act(unit, Command(verb, wanted, unit.points, args.swap), words)
