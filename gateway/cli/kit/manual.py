"""Writes the manual page: `python -m gateway.cli.kit.manual > deploy/man/modbus-gateway.1`."""

import sys
from collections.abc import Iterator
from typing import Final

from gateway.cli.kit.examples import EXAMPLES
from gateway.cli.kit.grammar import Argument, Verb, grammar

_OPENING: Final = """\
.\\" Made by `python -m gateway.cli.kit.manual`: change the texts in gateway/cli.
.TH MODBUS-GATEWAY 1
.SH NAME
modbus-gateway, mbgw \\- Modbus gateway for many serial lines
.SH SYNOPSIS
.B modbus-gateway
.I COMMAND
[\\fIARGUMENT\\fR ...]
.SH DESCRIPTION
Modbus TCP, UDP and serial clients on one side, serial lines with RTU and ASCII devices on the other.
.PP
.B modbus-gateway
.I COMMAND
.B \\-\\-help
shows the arguments of a command.
"""
_ENDING: Final = """\
.SH FILES
.TP
.I /etc/modbus-gateway/gateway.toml
The config file. After a change:
.B modbus-gateway check && systemctl reload modbus-gateway
.TP
.I /usr/share/doc/modbus-gateway/examples
Config files to start from.
.TP
.I /var/lib/modbus-gateway
Persistent images, and values remembered over a restart.
.TP
.I /run/modbus-gateway/control.sock
Control socket, by which the commands ask the running gateway.
.SH EXIT STATUS
0: fine. 1: a problem was found. 2: wrong usage.
.SH SEE ALSO
.I /usr/share/doc/modbus-gateway/docs/configuration.md
.br
.I /usr/share/doc/modbus-gateway/docs/operations.md
.br
.I /usr/share/doc/modbus-gateway/docs/tools.md
"""


def manual() -> str:
    """The page, for roff."""
    commands = [line for verb in grammar() for line in _command(verb)]
    return _OPENING + ".SH COMMANDS\n" + "\n".join(commands) + "\n" + _ENDING


def _command(verb: Verb) -> Iterator[str]:
    """A command: what it does, its arguments, an example."""
    words = " ".join(one.usage for one in verb.words)
    yield f".SS {_escaped(f'{verb.name} {words}'.strip())}"
    yield _line(f"{verb.summary[0].upper()}{verb.summary[1:]}.")
    for argument in (*verb.words, *verb.options):
        if "--help" not in argument.flags:
            yield from _argument(argument)
    for typed, what in EXAMPLES.get(verb.name, ()):
        yield f".PP\n\\fBmodbus\\-gateway {_escaped(typed)}\\fR\n.br"
        yield _line(f"{what[0].upper()}{what[1:]}.")


def _argument(argument: Argument) -> Iterator[str]:
    flags = ", ".join(f"\\fB{_escaped(flag)}\\fR" for flag in argument.flags)
    value = f"\\fI{_escaped(argument.value)}\\fR" if argument.value else ""
    yield ".TP"
    yield " ".join(filter(None, (flags, value)))
    yield _line(argument.help or "See above")


def _line(text: str) -> str:
    """A line of text: one that began with a dot or a quote would be an order to roff."""
    return ("\\&" if text[:1] in ".'" else "") + _escaped(text)


def _escaped(text: str) -> str:
    return text.replace("\\", "\\e").replace("-", "\\-")


if __name__ == "__main__":
    sys.stdout.write(manual())
