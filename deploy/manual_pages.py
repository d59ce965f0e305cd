"""Writes the manual pages, modbus-gateway(1) and modbus-gateway.toml(5), into a folder: what build-deb packs.

    .venv/bin/python -m deploy.manual_pages FOLDER

The first is made of the parsers of the command line, the second of docs/configuration.md. Neither is committed.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final
from unittest.mock import patch

from deploy.reference import document
from deploy.roff import manual_page
from gateway.cli.kit.examples import EXAMPLES
from gateway.cli.main import VERBS, parser_of_all

_DOCUMENTS: Final = "/usr/share/doc/modbus-gateway"
_COMMAND: Final = """\
# Name

modbus-gateway - Modbus gateway for many serial lines

# Synopsis

`modbus-gateway` COMMAND ...

# Description

One program between Modbus clients on the network and serial lines full of Modbus devices. `modbus-gateway` COMMAND
`--help` shows the arguments of a command, `modbus-gateway --version` the version. `mbgw` is the same program.
"""
_AFTER_COMMANDS: Final = f"""\
# Files

| file | what |
|---|---|
| `/etc/modbus-gateway/gateway.toml` | The config file: see `modbus-gateway.toml`(5). After a change: `modbus-gateway check && systemctl reload modbus-gateway` |
| `{_DOCUMENTS}/examples` | Config files to start from. |
| `/var/lib/modbus-gateway` | Persistent images, and values remembered over a restart. |
| `/run/modbus-gateway/control.sock` | Control socket, by which the commands ask the running gateway. |

# Exit status

0: fine. 1: a problem was found. 2: wrong usage.

# See also

`modbus-gateway.toml`(5), `{_DOCUMENTS}/docs`
"""  # noqa: E501 - a table of Markdown has no shorter lines
_CONFIG: Final = """\
# Name

modbus-gateway.toml - config file of the Modbus gateway

"""
_AFTER_CONFIG: Final = f"""\

# See also

`modbus-gateway`(1), `{_DOCUMENTS}/docs`, whose pages this one names, `{_DOCUMENTS}/examples`
"""


def pages() -> dict[str, str]:
    """Make the content of each file."""
    config = document().replace("# Configuration\n", "# Description\n", 1)
    return {
        "modbus-gateway.1": manual_page("modbus-gateway", 1, "Commands", "\n".join(_command())),
        "modbus-gateway.toml.5": manual_page(
            "modbus-gateway.toml", 5, "File formats", _CONFIG + config + _AFTER_CONFIG
        ),
    }


def _command() -> Iterator[str]:
    _, verbs = parser_of_all()
    yield _COMMAND
    yield "# Commands\n"
    with patch.dict(os.environ, COLUMNS="10000"):  # roff wraps lines itself
        for verb, each in verbs.items():
            yield f"### modbus-gateway {verb}\n\n{VERBS[verb][0].upper()}{VERBS[verb][1:]}.\n"
            yield from _arguments(each)
            yield from _below(each)
            for typed, what in EXAMPLES[verb]:
                yield f"{what[0].upper()}{what[1:]}:\n\n    modbus-gateway {typed}\n"
    yield _AFTER_COMMANDS


def _below(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Write what the commands of a command take, such as `user add`."""
    for verbs in (action.choices for action in parser._actions if isinstance(action.choices, dict)):  # noqa: SLF001 - argparse has no public way to ask for them
        for each in verbs.values():
            yield f"### {each.prog}\n"
            yield from _arguments(each)


def _arguments(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Write the usage, and a row for each argument; `-h` is the same everywhere."""
    usage = parser.format_usage().removeprefix("usage: ").strip()
    yield f"`{usage}`\n"
    formatter = parser.formatter_class(parser.prog)
    rows = []
    for action in parser._actions:  # noqa: SLF001 - as above
        if action.help == argparse.SUPPRESS or "--help" in action.option_strings:
            continue
        if isinstance(action.choices, dict):
            rows += [(choice.dest, choice.help) for choice in action._get_subactions()]  # noqa: SLF001
            continue
        invocation = formatter._format_action_invocation(action)  # noqa: SLF001
        rows.append((invocation, formatter._expand_help(action) if action.help else ""))  # noqa: SLF001
    if rows:
        yield "| argument | what |\n|---|---|"
        for term, told in rows:
            cells = [text.replace("|", "\\|") for text in (f"`{term}`", told)]
            yield f"| {' | '.join(cells)} |"
        yield ""


if __name__ == "__main__":
    for name, content in pages().items():
        Path(sys.argv[1], name).write_text(content, encoding="utf-8")
