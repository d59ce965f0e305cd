"""Options of mbpoll: for users who type them by habit, the error shows the same command in this program's words."""

import argparse
from collections.abc import Mapping, Sequence
from typing import Any, Final

from gateway.cli.kit.usage import WrongUsageError
from gateway.modbus.codes import Area
from gateway.registers.datatypes import registers_of

#: Options of mbpoll that take a value, and -B, which takes none. -1 and -0 would make numbers below zero options.
_WITH_VALUE: Final = ("-a", "-r", "-c", "-t", "-m", "-b", "-d", "-s", "-P", "-l", "-o", "-p")
_BIG_ENDIAN: Final = "-B"

_AREAS: Final[Mapping[str, Area]] = {
    "0": Area.COILS,
    "1": Area.DISCRETE,
    "3": Area.INPUT,
    "4": Area.HOLDING,
}
_TYPES: Final[Mapping[str, str]] = {"int16": "int16", "int": "int32", "float": "float32", "string": "string"}


class _Habit(argparse.Action):
    """Stores an option of mbpoll for `refuse_habits`."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,  # noqa: ARG002 - as argparse calls it
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        namespace.habits = {**(getattr(namespace, "habits", None) or {}), option_string: values}


def add_habits(parser: argparse.ArgumentParser) -> None:
    """Add the options of mbpoll; `--help` does not show them."""
    for option in _WITH_VALUE:
        parser.add_argument(option, dest="habits", action=_Habit, help=argparse.SUPPRESS)
    parser.add_argument(_BIG_ENDIAN, dest="habits", action=_Habit, nargs=0, help=argparse.SUPPRESS)


def refuse_habits(verb: str, args: argparse.Namespace) -> None:
    """Refuse options of mbpoll, and say what to type instead."""
    habits: Mapping[str, Any] = args.habits or {}
    if habits:
        raise WrongUsageError(f"{', '.join(sorted(habits))}: options of mbpoll", _translate(verb, args, habits))


def _translate(verb: str, args: argparse.Namespace, habits: Mapping[str, Any]) -> str:
    """Translate mbpoll's options into a command, as far as they say it; mbpoll counts from 1 unless -0 is given."""
    number, _, kind = str(habits.get("-t", "4")).partition(":")
    area, data_type = _AREAS.get(number, Area.HOLDING), _TYPES.get(kind, "")
    values = [word for word in args.words if word not in ("-0", "-1")]
    count = int(habits.get("-c", 1)) if str(habits.get("-c", 1)).isdecimal() else 1
    written = (values[1:] or ["VALUE"]) if verb == "write" else []
    start = int(habits.get("-r", 1)) if str(habits.get("-r", 1)).isdecimal() else 1
    first = start if "-0" in args.words else max(0, start - 1)
    last = first + count * registers_of(data_type) - 1
    addresses = str(first) if verb == "write" or last == first else f"{first}-{last}"
    words = [habits.get("-a", "1"), area, addresses, *written, data_type]
    words += ["--swap words"] if registers_of(data_type) > 1 and _BIG_ENDIAN not in habits else []
    words += [f"--tcp HOST:{habits['-p']}"] if "-p" in habits else []
    words += [f"--baud {habits['-b']}"] if "-b" in habits else []
    return " ".join(["modbus-gateway", verb, *(str(word) for word in words if word)])
