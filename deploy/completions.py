"""Writes the completions for shells, which follow from the parsers of the command line, by means of shtab.

    .venv/bin/python -m deploy.completions

`modbus-gateway completion SHELL` prints them, as files of the package: shtab is not needed where the gateway runs.
"""

import argparse
from pathlib import Path
from typing import Final

import shtab

from gateway.cli.main import parser_of_all
from gateway.cli.verbs.completion import SCRIPTS
from gateway.operator.operations.table import BY_NAME

COMPLETIONS: Final = Path(__file__).parents[1] / "gateway" / "cli" / "completions"

#: What takes files, by the name that its help has for its value.
_FILES: Final = {
    **dict.fromkeys(("config", "FILE", "PATH", "PORT"), shtab.FILE),
    "folder": shtab.DIRECTORY,
}


def completions() -> dict[Path, str]:
    """Make the content of each file."""
    return {COMPLETIONS / name: completion(shell) for shell, name in SCRIPTS.items()}


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


if __name__ == "__main__":
    for file, content in completions().items():
        file.write_text(content, encoding="utf-8")
