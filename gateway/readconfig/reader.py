"""The program of the process that reads a config: it writes an answer to stdout, and ends. See readconfig.process."""

import os
import pickle
import signal
import sys
from dataclasses import fields, is_dataclass
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any

from gateway.config.load import load
from gateway.config.machine.file_text import folder_of
from gateway.config.machine.troubles import address_trouble
from gateway.config.machine.unit_class import unit_trouble
from gateway.readconfig.process import READING_TIME, ConfigRead, made


def read_here(file: Path, *, look_around: bool = False) -> ConfigRead:
    """Read `file` in this process. See process.ReadConfig."""
    made = partial(unit_trouble, folder=folder_of(file))
    if not look_around:
        loaded = load(file, unit_trouble=made)
    else:
        from gateway.readconfig.file_troubles import with_file_troubles  # noqa: PLC0415 - it needs TLS, others do not

        loaded = load(file, address_trouble=address_trouble, unit_trouble=made)
        loaded = with_file_troubles(loaded, str(file))
    return ConfigRead(loaded.plan, loaded.problems, loaded.text, loaded.profile_texts)


def packed(read: object) -> bytes:
    """Pickle what was `read` for a process with the same modules."""
    target = BytesIO()
    _Pickler(target, pickle.HIGHEST_PROTOCOL).dump(read)
    return target.getvalue()


def main() -> None:
    """Read the file that the arguments name, or a text for it from stdin, write the pickled answer to stdout, and exit.

    The answer is a ConfigRead, or a TextCheck.
    """
    file, kind = sys.argv[1:]
    target = _answers_apart()
    signal.alarm(int(READING_TIME) + 1)  # ends this process if the disk hangs and the gateway is gone
    if kind == "text":
        from gateway.readconfig.text_reader import check_given_text  # noqa: PLC0415 - only needed for this

        answer = packed(check_given_text(Path(file), sys.stdin.buffer.read()))
    else:
        answer = packed(read_here(Path(file), look_around=kind == "look-around"))
    with os.fdopen(target, "wb") as stream:
        stream.write(answer)
    os._exit(0)  # to unload the modules would take a tenth of the time


def _answers_apart() -> int:
    """Return where answers go, and let all else that writes to stdout write to stderr: code of units, and what it runs.

    Programs that it starts, and copies of this process, do not keep the answer open.
    """
    target = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    os.register_at_fork(after_in_child=partial(os.close, target))
    return target


@cache
def _names(kind: type[Any]) -> tuple[str, ...]:
    """List the fields that are given when an object is made, in their order."""
    return tuple(each.name for each in fields(kind) if each.init)


class _Pickler(pickle.Pickler):
    """A pickler of dataclasses by their fields: those of compiled modules cannot be pickled in the usual way."""

    def reducer_override(self, value: Any) -> Any:
        if not is_dataclass(value) or isinstance(value, type):
            return NotImplemented
        names = _names(type(value))  # one object for each type, which is written once
        return made, (type(value), names, tuple(getattr(value, name) for name in names))
