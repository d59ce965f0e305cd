"""The operations of a gateway, as `ask` lists them."""

from collections.abc import Iterable
from typing import Any

from gateway.operator.operations.operation import Operation
from gateway.operator.operations.parameters import parameters_of


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
