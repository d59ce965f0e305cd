"""Reads a config in a process of its own, which ends once the plan is made.

The code that reads and checks a config takes a third of the gateway's memory, and is not needed later (ADR 24). This
module is imported before almost everything else: the gateway loads the rest while its config is read.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIG_BLOCK, SIG_SETMASK, Signals, pthread_sigmask
from threading import Thread
from typing import IO, TYPE_CHECKING, Any, Final, Protocol

from gateway.config.problem import Problem, errors_in
from gateway.errors import ConfigError
from gateway.version import __version__

if TYPE_CHECKING:
    from gateway.config.plan.settings import Plan

#: How long reading may take, in seconds. A slow machine may be busy, as when it boots.
READING_TIME: Final = 60.0

#: How long the process may take to end once it is killed, in seconds.
_ENDING_TIME: Final = 1.0
#: The last line of its standard error goes to the log, up to this many characters.
_MOST_SAID: Final = 200
#: So many bytes of it are read at a time, and kept.
_MOST_READ: Final = 65536

#: What an answer raises that modules of the same version, but with other content, have made.
_OF_OTHER_MODULES: Final = (pickle.UnpicklingError, EOFError, TypeError, AttributeError, ImportError, ValueError)
_CHANGED: Final = "modbus-gateway has been changed since its start; restart it"
#: Imports from this process's `sys.path`, its last argument; the modules there may be newer by now. It ends before
#: collecting garbage would be worth its time.
_PROGRAM: Final = f"""\
import gc, sys
gc.disable()
sys.path[:] = sys.argv.pop().split(":")
from gateway.version import __version__
if __version__ != {__version__!r}:
    sys.exit("{_CHANGED}")
from gateway.readconfig.reader import main
main()
"""


@dataclass(frozen=True, slots=True)
class ConfigRead:
    """A file that was read: its plan if it has no error, its problems in the order of the file, and its text.

    `profile_texts` are those of own profiles that it uses, by their names.
    """

    plan: "Plan | None"
    problems: tuple[Problem, ...]
    text: str = ""
    profile_texts: Mapping[str, str] = field(default_factory=dict)

    @property
    def errors(self) -> tuple[str, ...]:
        """The problems that are errors, as text: the reasons why there is no plan."""
        return errors_in(self.problems)


def made(kind: Callable[..., Any], names: tuple[str, ...], values: tuple[Any, ...]) -> Any:
    """Make an object of an answer. As this is no compiled code, the lines get their turns while a plan is taken in."""
    return kind(**dict(zip(names, values, strict=True)))


class ReadConfig(Protocol):
    """Reads a file. With `look_around`, its problems include those of other files and of this machine."""

    def __call__(self, file: Path, *, look_around: bool = False) -> ConfigRead:
        """Read `file`. Blocks."""
        ...


def read_config(file: Path, *, look_around: bool = False) -> ConfigRead:
    """Read `file` in a process of its own. Blocks for little more than READING_TIME at most.

    Raises:
        ConfigError: the process cannot be started, fails, or takes too long; the message says which.
    """
    return ConfigProcess(file, look_around=look_around).result()


class ConfigProcess:
    """A process that reads `file`, started at once.

    Raises:
        ConfigError: it cannot be started.
    """

    def __init__(self, file: Path, *, look_around: bool = False) -> None:
        self._process = Reading(str(file), [str(file), "look-around" if look_around else "plan"])

    def result(self) -> ConfigRead:
        """Return what was read; wait for READING_TIME at most, and a second for the process to end.

        Raises:
            ConfigError: the process fails, or takes too long; the message says why.
        """
        read: ConfigRead = self._process.result(READING_TIME, "; is its disk there?")
        return read


class Reading:
    """A process that answers with an object, started at once. `what` it reads is named in messages.

    Raises:
        ConfigError: it cannot be started.
    """

    def __init__(self, what: str, words: Sequence[str], given: bytes | None = None) -> None:
        self._what = what
        self._given = given
        python = [sys.executable, "-I", "-S", "-X", f"pycache_prefix={sys.pycache_prefix or ''}", "-c", _PROGRAM]
        # `systemctl kill --signal=HUP` sends it to all processes of the service, and means the gateway.
        before = pthread_sigmask(SIG_BLOCK, {Signals.SIGHUP})
        try:
            self._process = subprocess.Popen(  # noqa: S603 - this interpreter, and a program of ours
                [*python, *words, ":".join(sys.path)],
                stdin=subprocess.DEVNULL if given is None else subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                process_group=0,  # Ctrl-C is for the gateway, which ends it
            )
        except OSError as error:
            raise ConfigError(f"{what} cannot be read: no process can be started for it: {error.strerror}") from None
        finally:
            pthread_sigmask(SIG_SETMASK, before)
        self._said = _LastSaid(self._process)

    def result(self, limit: float, hint: str = "") -> Any:
        """Return its answer; wait for `limit` seconds at most, and one more for the process to end.

        Raises:
            ConfigError: the process fails, or takes too long, of which `hint` says more; the message says why.
        """
        process = self._process
        try:
            answer, _ = process.communicate(self._given, timeout=limit)
        except subprocess.TimeoutExpired:
            raise ConfigError(f"{self._what}: cannot be read within {limit:g} s{hint}") from None
        finally:
            process.kill()  # if it still runs
            if process.stdin is not None:
                process.stdin.close()
            with suppress(subprocess.TimeoutExpired):  # a file system hangs
                process.communicate(timeout=_ENDING_TIME)
        if process.returncode or not answer:
            raise ConfigError(f"{self._what} was not read: {_explain(process.returncode, self._said.line())}")
        try:
            return pickle.loads(answer)  # noqa: S301 - from our own process, through its pipe
        except _OF_OTHER_MODULES as error:
            raise ConfigError(f"{self._what} was not read: {_CHANGED} ({error!r})") from error


class _LastSaid:
    """Reads what a process writes to its standard error: code that it imports may write without end."""

    def __init__(self, process: "subprocess.Popen[bytes]") -> None:
        """Take it from `process`, for which nobody else may read it."""
        pipe, process.stderr = process.stderr, None
        self._last = b""
        self._reading = Thread(target=self._read, args=(pipe,), name="what reading says", daemon=True)
        self._reading.start()

    def line(self) -> str:
        """Return the last line of a process that has ended. Programs that it has started may still write."""
        self._reading.join(_ENDING_TIME)
        return self._last.decode(errors="replace").strip().rpartition("\n")[2][:_MOST_SAID]

    def _read(self, pipe: IO[bytes]) -> None:
        with pipe:
            while said := os.read(pipe.fileno(), _MOST_READ):
                self._last = (self._last + said)[-_MOST_READ:]


def _explain(status: int, last: str) -> str:
    if status < 0:
        names = {each.value: each.name for each in Signals}  # real-time signals have none
        return f"the process that reads it was ended by {names.get(-status, f'signal {-status}')}; is memory short?"
    if not status:
        return "the process that reads it has ended without an answer"
    return f"the process that reads it has failed with status {status}{last and f': {last}'}"
