"""Writes what follows from the command line: the manual page, and completions for shells.

    .venv/bin/python -m deploy.command_files

`argparse-manpage` and `shtab` read our parsers. Neither is needed where the gateway runs.
"""

import argparse
import os
from pathlib import Path
from typing import Final
from unittest.mock import patch

import shtab
from argparse_manpage.manpage import Manpage

from gateway.cli.kit.examples import EXAMPLES
from gateway.cli.main import VERBS, parser_of_all
from gateway.cli.verbs.completion import SCRIPTS
from gateway.operator.operations import BY_NAME

_CHECKOUT: Final = Path(__file__).parents[1]
MANUAL: Final = _CHECKOUT / "deploy" / "man" / "modbus-gateway.1"
COMPLETIONS: Final = _CHECKOUT / "gateway" / "cli" / "completions"

#: What takes files, by the name that its help has for its value.
_FILES: Final = {
    **dict.fromkeys(("config", "FILE", "PATH", "PORT"), shtab.FILE),
    "folder": shtab.DIRECTORY,
}


def command_files() -> dict[Path, str]:
    """Make the content of each file."""
    with patch.dict(os.environ, COLUMNS="10000"):  # roff wraps lines itself
        completions = {COMPLETIONS / name: completion(shell) for shell, name in SCRIPTS.items()}
        return {MANUAL: manual(), **completions}


def completion(shell: str) -> str:
    """Make the script that completes our commands in `shell`, under both names of the program."""
    parser, verbs = parser_of_all()
    _mark_files(parser)
    _offer_operations(verbs["ask"])
    script = str(shtab.complete(parser, shell))
    if shell == "zsh":
        return script.replace("#compdef modbus-gateway", "#compdef modbus-gateway mbgw", 1) + "\n"
    other = {
        "bash": "complete -o bashdefault -o default -F _shtab_modbus_gateway modbus-gateway mbgw",
        "fish": "complete -c mbgw -w modbus-gateway",
    }
    return f"{script}\n{other[shell]}\n"


def _mark_files(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:  # noqa: SLF001 - argparse has no public way to ask for them
        if isinstance(action.choices, dict):
            for each in action.choices.values():
                _mark_files(each)
        elif (name := action.metavar or action.dest) in _FILES:
            action.complete = _FILES[name]


def _offer_operations(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:  # noqa: SLF001 - as above
        if action.metavar == "NAME":
            action.choices = tuple(BY_NAME)


def manual() -> str:
    """Make the page, for roff."""
    parser, verbs = parser_of_all()
    for each in verbs.values():
        each.description = None  # it is the summary, which the page has already
    page = Manpage(parser, format="single-commands-section")
    page.date = ""
    page.manual = "Commands"
    page.description = "Modbus gateway for many serial lines"
    page.add_section("EXAMPLES", "=", "\n".join(_example(*each) for verb in VERBS for each in EXAMPLES[verb]))
    page.parse_include(str(MANUAL.with_name("sections.roff")))
    return f'.\\" Made by deploy/command_files.py: change the texts in gateway/cli.\n{page}'


def _example(typed: str, what: str) -> str:
    words = f"modbus-gateway {typed}".replace("\\", "\\e").replace("-", "\\-")
    return f".TP\n.B {words}\n{what[0].upper()}{what[1:]}."


if __name__ == "__main__":
    for file, content in command_files().items():
        file.write_text(content, encoding="utf-8")
