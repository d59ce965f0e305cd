"""`ask`: any operation of a running gateway by its name, with its answer as JSON; alone, all operations."""

import argparse
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, tell_which, which_gateway
from gateway.cli.kit.usage import WrongUsageError, let_options_stand_anywhere
from gateway.cli.main import FINE, PROBLEM_FOUND
from gateway.config.problem import did_you_mean
from gateway.errors import WrongQuestion
from gateway.operator.operations.operation import Operation
from gateway.operator.operations.parameters import Parameter, parameters_of, read_parameters
from gateway.operator.operations.table import BY_NAME

#: How long the gateway may take, in seconds: a measurement may last an hour, and says nothing meanwhile.
_PATIENCE: Final = 3700.0

_ABOUT: Final = """\
A VALUE is JSON where the parameter can have such a value, else text. The answer
is what the gateway tells, as JSON; of an operation with several answers each is on
a line of its own.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ask`."""
    parser.epilog = _ABOUT
    parser.add_argument("name", nargs="?", metavar="NAME", help="the operation (default: list all)")
    parser.add_argument("values", nargs="*", metavar="KEY=VALUE", help="its parameters")
    add_control_argument(parser)
    let_options_stand_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Ask and print the answer; 1 if it is that of a reload whose file was rejected."""
    if args.name is None:
        print(show_operations(BY_NAME.values()))
        return FINE
    operation = _find(args.name)
    asked = _read(operation, args.values)
    with Conversation(which_gateway(args)) as daemon:
        if operation.right != "reading":
            tell_which(daemon.gateway)
        daemon.wait_for(_PATIENCE)
        if operation.is_repeated:
            for answer in daemon.answers_in_json(operation, asked):
                print(json.dumps(_told(operation, answer), ensure_ascii=False), flush=True)
            return FINE
        answer = daemon.ask_for_json(operation, asked)
        print(json.dumps(_told(operation, answer), indent=2, ensure_ascii=False))
        return FINE if answer.get("ok") is True else PROBLEM_FOUND


def _find(name: str) -> Operation[Any, Any]:
    if name not in BY_NAME:
        remedy = did_you_mean(name, BY_NAME) or "modbus-gateway ask lists them"
        raise WrongUsageError(f'there is no operation "{name}"', remedy)
    return BY_NAME[name]


def _read(operation: Operation[Any, Any], words: Sequence[str]) -> Any:
    """Read the parameters."""
    known = {each.name: each for each in parameters_of(operation.parameters)}
    remedy = show_parameters(operation)
    given: dict[str, object] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if not equals or key not in known:
            wrong = f'{operation.name} has no parameter "{key}"' if equals else f'"{word}" is not KEY=VALUE'
            raise WrongUsageError(wrong, remedy)
        if key in given:
            raise WrongUsageError(f'"{key}" is there twice', remedy)
        given[key] = _value(known[key], text)
    try:
        return read_parameters(operation.parameters, given)
    except WrongQuestion as wrong:
        raise WrongUsageError(str(wrong), remedy) from None


def _value(parameter: Parameter, text: str) -> object:
    try:
        value: object = json.loads(text)
    except (ValueError, RecursionError):
        return text
    return value if parameter.takes(value) or str not in parameter.types else text


def _told(operation: Operation[Any, Any], answer: Mapping[str, Any]) -> Any:
    """Take the result out of an answer."""
    if operation.key:
        return answer.get(operation.key)
    of_the_socket = {"version", "ok"} - {each.name for each in fields(operation.result)}
    return {name: each for name, each in answer.items() if name not in of_the_socket}


def show_operations(operations: Iterable[Operation[Any, Any]]) -> str:
    """List the operations, each with its parameters, the right that it needs, and where it is over HTTP."""
    return "\n\n".join(map(_show, operations))


def show_parameters(operation: Operation[Any, Any]) -> str:
    """Say on one line what an operation must be told, and what it may be told."""
    parameters = parameters_of(operation.parameters)
    if not parameters:
        return f"modbus-gateway ask {operation.name}"
    told = ", ".join(f"{each.name} ({each.what}{'' if each.is_required else ', optional'})" for each in parameters)
    return f"the parameters of {operation.name}: {told}"


def _show(operation: Operation[Any, Any]) -> str:
    where = "" if operation.path is None else f"; HTTP: {operation.method} /api/v1{operation.path}"
    several = "; several answers" if operation.is_repeated else ""
    lines = [operation.name, f"  {operation.summary}", f"  right: {operation.right}{where}{several}"]
    parameters = parameters_of(operation.parameters)
    width = max((len(each.name) for each in parameters), default=0)
    lines += [f"    {each.name:{width}}  {each.what}{'' if each.is_required else ' (optional)'}" for each in parameters]
    return "\n".join(lines)
