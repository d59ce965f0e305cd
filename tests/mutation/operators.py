"""Which mutants there are: operators of cosmic-ray that do not repeat one another, and two of our own.

cosmic-ray replaces each operator by every other one. Most of these mutants die of a TypeError, or wherever another one
dies, and so they say nothing of the tests. Here a comparison is negated or has its bound moved, and an operator becomes
its opposite, as in PIT.
"""

import ast
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Final

import cosmic_ray.plugins
import parso
from cosmic_ray.operators.operator import Operator

_COMPARISONS: Final = {
    "Lt": ("LtE", "GtE"),
    "Gt": ("GtE", "LtE"),
    "LtE": ("Lt", "Gt"),
    "GtE": ("Gt", "Lt"),
    "Eq": ("NotEq",),
    "NotEq": ("Eq",),
    "Is": ("IsNot",),
    "IsNot": ("Is",),
}
_BINARY: Final = {
    "Add": "Sub",
    "Sub": "Add",
    "Mul": "Div",
    "Div": "Mul",
    "FloorDiv": "Mul",
    "Mod": "FloorDiv",
    "Pow": "Mul",
    "RShift": "LShift",
    "LShift": "RShift",
    "BitOr": "BitAnd",
    "BitAnd": "BitOr",
    "BitXor": "BitAnd",
}

Place = tuple[tuple[int, int], tuple[int, int]]


class RemoveStatement(Operator):
    """Puts `pass` in the place of a call or an assignment."""

    def mutation_positions(self, node: Any) -> Iterator[Place]:
        if _is_removable(node):
            yield node.start_pos, node.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        node.children[0] = parso.parse(node.get_first_leaf().prefix + "pass")
        return node

    @classmethod
    def examples(cls) -> Sequence[Any]:
        return ()


def _is_removable(node: Any) -> bool:
    if node.type != "simple_stmt":
        return False
    statement = node.children[0]
    if statement.type == "expr_stmt":
        return all(part.type != "annassign" for part in statement.children) and _is_in_function(node)
    return statement.type in {"atom_expr", "power"} or (statement.type == "await" and _is_in_function(node))


def _is_in_function(node: Any) -> bool:
    return parso.python.tree.search_ancestor(node, "funcdef") is not None


class RemoveOperand(Operator):
    """Leaves out one operand of `and` or `or`."""

    def mutation_positions(self, node: Any) -> Iterator[Place]:
        if node.type in {"and_test", "or_test"}:
            for operand in node.children[::2]:
                yield operand.start_pos, operand.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        first = node.get_first_leaf()
        prefix, first.prefix = first.prefix, ""
        if index:
            del node.children[2 * index - 1 : 2 * index + 1]
        else:
            del node.children[:2]
        node.get_first_leaf().prefix = prefix
        return node

    @classmethod
    def examples(cls) -> Sequence[Any]:
        return ()


class _Ours:
    _operators: Final = {operator.__name__: operator for operator in (RemoveStatement, RemoveOperand)}

    def __iter__(self) -> Iterator[str]:
        return iter(self._operators)

    def __getitem__(self, name: str) -> type[Operator]:
        return self._operators[name]


cosmic_ray.plugins.OPERATOR_PROVIDERS["gateway"] = _Ours()


def is_used(operator: str) -> bool:
    """Whether mutants of the operator of this name are made."""
    name = operator.partition("/")[2]
    if name.startswith("ReplaceComparisonOperator_"):
        _, old, new = name.split("_")
        return new in _COMPARISONS[old]
    if name.startswith("ReplaceBinaryOperator_"):
        _, old, new = name.split("_")
        return _BINARY[old] == new
    return True


def out_of_reach(source: str) -> list[Place]:
    """Where no test can tell mutants apart: types, and what a decorator is called with (frozen, slots).

    And what is taken for a multiplication or a division, but parts the parameters of a function.
    """
    found: list[Place] = []
    for node in ast.walk(ast.parse(source)):
        inside = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        inside += [
            argument for call in getattr(node, "decorator_list", ()) for argument in getattr(call, "keywords", ())
        ]
        found += (_place(each) for each in inside if each is not None)
    for row, line in enumerate(source.splitlines(), 1):
        found += (((row, at.start()), (row, at.end())) for at in re.finditer(r"[*/](?=,)", line))
    return found


def _place(node: Any) -> Place:
    return (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)


def is_within(place: Place, places: Iterable[Place]) -> bool:
    return any(start <= place[0] and place[1] <= end for start, end in places)
