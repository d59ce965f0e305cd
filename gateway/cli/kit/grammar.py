"""What the command line understands, as data: of this the manual page and the completions are made."""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

from gateway.cli.main import VERBS, parser_of_all


class Argument(NamedTuple):
    """An option, by its `flags`, or a word. `value` is what stands for its value; empty if it takes none.

    `choices` are all the values that it takes, if they are known.
    """

    flags: tuple[str, ...]
    value: str
    help: str
    choices: tuple[str, ...]
    is_required: bool

    @property
    def usage(self) -> str:
        """How it stands in a command."""
        text = " ".join(filter(None, (self.flags[-1] if self.flags else "", self.value)))
        return text if self.is_required else f"[{text}]"


class Verb(NamedTuple):
    """A command."""

    name: str
    summary: str
    arguments: tuple[Argument, ...]

    @property
    def words(self) -> tuple[Argument, ...]:
        """What stands without flags, in order."""
        return tuple(one for one in self.arguments if not one.flags)

    @property
    def options(self) -> tuple[Argument, ...]:
        """What has flags."""
        return tuple(one for one in self.arguments if one.flags)


def grammar() -> tuple[Verb, ...]:
    """Every command."""
    parsers = parser_of_all()
    return tuple(Verb(name, summary, tuple(_arguments(parsers[name]))) for name, summary in VERBS.items())


def _arguments(parser: argparse.ArgumentParser) -> Iterator[Argument]:
    """The arguments of a parser, in order; argparse has no public way to ask for them."""
    formatter = parser._get_formatter()  # noqa: SLF001
    for action in parser._actions:  # noqa: SLF001
        if action.help != argparse.SUPPRESS:
            text = formatter._expand_help(action) if action.help else ""  # noqa: SLF001
            choices = tuple(map(str, action.choices or ()))
            is_required = action.required and action.nargs != "*"
            yield Argument(tuple(action.option_strings), _value(action, choices), text, choices, is_required)


def _value(action: argparse.Action, choices: tuple[str, ...]) -> str:
    if action.nargs == 0:
        return ""
    if action.metavar is None:
        name = "|".join(choices) or action.dest.upper()
    else:
        name = " ".join(action.metavar) if isinstance(action.metavar, tuple) else action.metavar
    return f"{name} ..." if action.nargs == "+" else name
