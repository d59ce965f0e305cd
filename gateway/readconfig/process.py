"""Reads a config in a process of its own, which ends once the plan is made.

What reads and checks a config takes as much memory as all else of the gateway, and nothing of it is needed later
(ADR 24). This module is imported before almost everything else: the gateway loads itself while its config is read.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from signal import SIG_BLOCK, SIG_SETMASK, Signals, pthread_sigmask
from typing import TYPE_CHECKING, Any, Final, Protocol

from gateway import __version__
from gateway.config.problem import Problem, errors_in
from gateway.errors import ConfigError

if TYPE_CHECKING:
    from gateway.config.plan.settings import Plan

#: How long the process may take, in seconds. A slow machine may be busy, as when it boots.
READING_TIME: Final = 60.0

#: How long it may take to end once it is killed, in seconds.
_ENDING_TIME: Final = 1.0

#: With the modules of this process, wherever it has them from. The arguments are those of config_reader.main. It lives
#: too short for a garbage collection to be worth its time, and ends without taking apart what was loaded: for both the
#: gateway would wait.
_PROGRAM: Final = """\
import gc, os, sys
gc.disable()
sys.path[:] = sys.argv.pop().split(":")
from gateway.readconfig.reader import main
main()
sys.stdout.flush()
os._exit(0)
"""
#: What an answer begins with. The process runs what is installed now, the gateway what was installed at its start.
ANSWER: Final = f"\0config of modbus-gateway {__version__}\n".encode()
#: What taking over an answer of another version raises.
_NOT_OURS: Final = (pickle.UnpicklingError, EOFError, TypeError, AttributeError, ImportError, ValueError, LookupError)
#: What the process says of its own failure goes to the log, up to this many characters.
_MOST_SAID: Final = 200


@dataclass(frozen=True, slots=True)
class ConfigRead:
    """What a file says: its plan if it has no error, its problems in the order of the file, and its text."""

    plan: "Plan | None"
    problems: tuple[Problem, ...]
    text: str = ""

    @property
    def errors(self) -> tuple[str, ...]:
        """Why there is no plan, as text."""
        return errors_in(self.problems)


class ReadConfig(Protocol):
    """Reads a file. With `look_around`, what `check` says of other files and of this machine is among the problems."""

    def __call__(self, file: Path, *, look_around: bool = False) -> ConfigRead:
        """Read it. Blocks."""
        ...


def read_config(file: Path, *, look_around: bool = False) -> ConfigRead:
    """Read `file` in a process of its own. Blocks for at most READING_TIME.

    Raises:
        ConfigError: the process could not do it; the message says why.
    """
    return ConfigProcess(file, READING_TIME, look_around=look_around).result()


class ConfigProcess:
    """The process that reads `file`, from now on. It has `limit` seconds.

    Raises:
        ConfigError: it cannot be started.
    """

    def __init__(self, file: Path, limit: float, *, look_around: bool = False) -> None:
        self._file = file
        self._limit = limit
        kind = "look-around" if look_around else "plan"
        try:
            with _without_sighup():
                self._process = subprocess.Popen(  # noqa: S603 - this interpreter, and a program of ours
                    [*_interpreter(), str(file), kind, f"{limit:g}", str(os.getpid()), ":".join(sys.path)],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    process_group=0,  # Ctrl-C is for the gateway, which ends it
                )
        except OSError as error:
            raise ConfigError(f"{file} cannot be read: no process can be started for it: {error.strerror}") from None

    def result(self) -> ConfigRead:
        """Wait for what was read.

        Raises:
            ConfigError: the process did not come to its end; the message says why.
        """
        process = self._process
        try:
            answer, said = process.communicate(timeout=self._limit)
        except subprocess.TimeoutExpired:
            raise ConfigError(f"{self._file}: cannot be read within {self._limit:g} s; is its disk there?") from None
        finally:
            self._end()
        if process.returncode != 0:
            raise ConfigError(f"{self._file} was not read: {_explain(process.returncode, said)}")
        try:
            return _handed_over(answer)
        except _NOT_OURS:
            raise ConfigError(
                f"{self._file} was not read: modbus-gateway has been changed since its start; restart it"
            ) from None

    def _end(self) -> None:
        process = self._process
        if process.returncode is None:
            process.kill()
            with suppress(subprocess.TimeoutExpired):  # a file system hangs
                process.wait(_ENDING_TIME)
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()


def _handed_over(output: bytes) -> ConfigRead:
    """What the process has read, from its output: a library may have printed something before it.

    Raises:
        _NOT_OURS: it is of another version of the gateway.
    """
    _, begin, answer = output.partition(ANSWER)
    if not begin:
        raise ValueError
    read: ConfigRead = pickle.loads(answer)  # noqa: S301 - of our own process, by a pipe that nobody else has
    return read


@contextmanager
def _without_sighup() -> Iterator[None]:
    """A process that is started in this context never gets SIGHUP.

    `systemctl kill --signal=HUP` sends it to all processes of the service, and means the gateway.
    """
    before = pthread_sigmask(SIG_BLOCK, {Signals.SIGHUP})
    try:
        yield
    finally:
        pthread_sigmask(SIG_SETMASK, before)


def remake(kind: type[Any], values: dict[str, Any]) -> object:
    """Make a dataclass of its values: how config_reader hands one over. Compiled ones have no way of their own."""
    return kind(**values)


def _interpreter() -> list[str]:
    """Python with the same environment as here, for a program that sets its own path."""
    isolated = ["-I", "-S"] if sys.flags.isolated else ["-P"]
    bytecode = [] if sys.pycache_prefix is None else ["-X", f"pycache_prefix={sys.pycache_prefix}"]
    return [sys.executable, *isolated, *bytecode, "-c", _PROGRAM]


def _explain(status: int, said: bytes) -> str:
    last = said.decode(errors="replace").strip().rpartition("\n")[2][:_MOST_SAID]
    if status < 0:
        return f"the process that reads it was ended by {_name(-status)}; is memory short?"
    return f"the process that reads it has failed with status {status}{last and f': {last}'}"


def _name(number: int) -> str:
    try:
        return Signals(number).name
    except ValueError:
        return f"signal {number}"
