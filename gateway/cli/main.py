"""The command `modbus-gateway`: finds the module of the verb and runs it.

Each verb is a module of this package with its name. It offers

    def add_arguments(parser: argparse.ArgumentParser) -> None    its own arguments
    def run(args: argparse.Namespace) -> int                      the work; returns the exit code

and is imported only when it is used, so that `--help` is quick. A verb of several words has underscores in its
module's name. Errors for the user are raised as a GatewayError, whose text is complete, or as a WrongUsageError.
"""

import argparse
import gc
import os
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from typing import Any, Final

from gateway.cli.kit.examples import examples_text
from gateway.cli.kit.paint import red
from gateway.cli.kit.terminal import COLOURS, no_control_characters
from gateway.cli.kit.usage import WrongUsageError
from gateway.config.problem import did_you_mean
from gateway.errors import GatewayError
from gateway.version import __version__

FINE: Final = 0
PROBLEM_FOUND: Final = 1
WRONG_USAGE: Final = 2
INTERRUPTED: Final = 130

_ERROR: Final = f"modbus-gateway: {red('error')}:"
#: One prints a log, and these have commands of their own.
_WITHOUT_COLOUR: Final = frozenset({"run", "user", "certificates"})
#: These make many objects first, and all of them stay.
_WITHOUT_COLLECTIONS: Final = frozenset({"run", "check"})
_COLOUR_HELP: Final = "when to use colour (default auto: on a terminal, unless NO_COLOR is set)"
#: The default config file.
DEFAULT_CONFIG: Final = "/etc/modbus-gateway/gateway.toml"

VERBS: Final[Mapping[str, str]] = {
    "demo": "show the gateway with simulated devices",
    "run": "run the gateway in the foreground",
    "check": "check a config file and show its effect",
    "reload": "make the running gateway read its config again",
    "status": "show the state of the running gateway",
    "values": "show the latest values of all points, without asking a device",
    "trace": "show what passes on the lines, and why requests failed",
    "events": "show what has happened, and what happens",
    "doctor": "find what is wrong with ports, lines, units and clients",
    "support": "write a diagnostics bundle, for who helps you",
    "read": "read coils and registers of a unit",
    "write": "write coils and registers of a unit",
    "ask": "ask the running gateway anything that it can be asked",
    "forget": "ask a device that moved where the config says again",
    "scan": "find the units that answer on a line",
    "calibrate": "measure how long a device needs to respond",
    "bench": "measure what a line can carry",
    "profile": "list, show and add kinds of devices",
    "map": "show the registers of a unit, for those who set up its clients",
    "ports": "list the serial ports of this machine",
    "simulate": "run simulated devices on a virtual port, or behind a server",
    "import": "turn the config of another program into one for the gateway, or a table of registers into a profile",
    "completion": "print a script that completes commands in a shell",
    "fleet": "write the config of the NATS server of a fleet, and the logins of its sites",
    "user": "manage the users of the web page, and tokens of programs",
    "certificates": "make certificates for tls:// and https://",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line `arguments` and return the exit code: 0 fine, 1 a problem was found, 2 wrong usage.

    Without a command it says what to do first.
    """
    words = sys.argv[1:] if arguments is None else list(arguments)
    # Only this program's own code reads its config. To look for plugins of other packages takes 20 ms of each start.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    if not words:
        return _tell_first_steps()
    with _without_collections() if words[0] in _WITHOUT_COLLECTIONS else nullcontext():
        args = _parser(words).parse_args(words)
        with no_control_characters(getattr(args, "color", "auto")):
            return _run(args)


@contextmanager
def _without_collections() -> Iterator[None]:
    """Collect no garbage inside the context, or until the command wants it: a fifth of the time of a start."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _tell_first_steps() -> int:
    from gateway.cli.kit.first_steps import first_steps  # noqa: PLC0415 - only without a command

    with no_control_characters():
        print(f"modbus-gateway {__version__}. `modbus-gateway --help` lists its commands.\n")
        print(first_steps(Path(DEFAULT_CONFIG)), flush=True)
    return WRONG_USAGE


def _run(args: argparse.Namespace) -> int:
    try:
        code: int = module_of(args.verb).run(args)
        if sys.stdout is not None:
            sys.stdout.flush()
    except WrongUsageError as wrong:
        print(f"{_ERROR} {wrong}" + (f"\n  help: {wrong.remedy}" if wrong.remedy else ""), file=sys.stderr)
        return WRONG_USAGE
    except GatewayError as error:
        print("\n  note: ".join([f"{_ERROR} {error}", *getattr(error, "__notes__", ())]), file=sys.stderr)
        return PROBLEM_FOUND
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        # The reader of the output has gone; Python would report an error when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            print(f"{_ERROR} {error}", file=sys.stderr)
        return PROBLEM_FOUND
    return code


def module_of(verb: str) -> Any:
    """Load the module of a verb. If the verb is a keyword of Python, its module has an underscore at the end."""
    return import_module(f"gateway.cli.verbs.{verb}_" if iskeyword(verb) else f"gateway.cli.verbs.{verb}")


class _Help(argparse.HelpFormatter):
    """Leaves room for the longest verb beside its summary: argparse forgets by how much verbs are indented."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = max(map(len, VERBS)) + 2 * self._indent_increment


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Make the parser for these words: of the verb that they begin with, or of all; only theirs has its arguments."""
    if words and words[0] in VERBS:
        parser, _ = _parsers(words[:1], with_arguments=words[:1])
        return parser
    wanted = next((word for word in words if not word.startswith("-")), None)
    parser, _ = _parsers(VERBS, with_arguments=[wanted] if wanted else [])
    if wanted is not None and wanted not in VERBS:
        nearest = did_you_mean(wanted, VERBS)
        parser.error(f"there is no command {wanted}; {nearest or 'modbus-gateway --help lists them'}")
    return parser


def parser_of_all() -> tuple[argparse.ArgumentParser, Mapping[str, argparse.ArgumentParser]]:
    """Make the whole parser with the arguments of all verbs, and return it and the parsers of the verbs."""
    return _parsers(VERBS, with_arguments=VERBS)


def _parsers(
    names: Collection[str], *, with_arguments: Collection[str]
) -> tuple[argparse.ArgumentParser, dict[str, argparse.ArgumentParser]]:
    """Make the whole parser, and those of the verbs with these names."""
    parser = argparse.ArgumentParser(
        prog="modbus-gateway",
        description="Modbus gateway: TCP, UDP and serial clients on one side, serial lines on the other.",
        formatter_class=_Help,
    )
    parser.add_argument("--version", action="version", version=f"modbus-gateway {__version__}")
    verbs = parser.add_subparsers(title="commands", dest="verb", metavar="COMMAND", required=True)
    for verb in names:
        verb_parser = verbs.add_parser(
            verb,
            help=VERBS[verb],
            description=f"{VERBS[verb][0].upper()}{VERBS[verb][1:]}.",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if verb in with_arguments:
            module_of(verb).add_arguments(verb_parser)
            if verb not in _WITHOUT_COLOUR:
                verb_parser.add_argument("--color", choices=COLOURS, default="auto", help=_COLOUR_HELP)
            verb_parser.epilog = "\n\n".join(filter(None, (examples_text(verb), verb_parser.epilog)))
    return parser, verbs.choices


if __name__ == "__main__":
    sys.exit(main())
