"""Requests to a running gateway through its control socket."""

import argparse
import json
import socket
import struct
import sys
import tomllib
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from gateway import __version__
from gateway.cli.main import DEFAULT_CONFIG
from gateway.errors import DaemonError
from gateway.service.control_path import SYSTEM_SOCKET, control_path

#: How long the gateway may take to answer, in seconds. A reload may need 60 to read the file, 15 to look up names, 3
#: for requests in progress, and 1.5 to close ports.
_PATIENCE: Final = 90.0
#: `struct ucred`: the process at the other end of a socket, its user and group.
_PEER: Final = struct.Struct("=3i")
#: Shown for values that a gateway of another version does not have.
UNKNOWN: Final = "unknown"
#: What an answer in an unexpected form raises where it is taken apart or shown.
NOT_UNDERSTOOD: Final = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, struct.error)


def add_control_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--control`."""
    parser.add_argument(
        "--control", metavar="PATH", help=f"the gateway's control socket (default: as {DEFAULT_CONFIG} says)"
    )


def ask(verb: str, control: str | None) -> dict[str, Any]:
    """The gateway's answer to one request. A gateway of another version is reported on standard error.

    Raises:
        DaemonError: it does not answer, or refuses the request.
    """
    with Conversation(control) as daemon:
        return daemon.ask(verb)


class Conversation:
    """A connection to the gateway for any number of requests; open inside the context.

    Answers are taken apart and shown inside the context: there, one of another version's gateway that has another form
    becomes a DaemonError with the same notes.

    Raises:
        DaemonError: no gateway can be reached, or it does not answer, or refuses a request.
    """

    def __init__(self, control: str | None) -> None:
        self._sock = _connect(control)
        self._stream = self._sock.makefile("rb")
        self._patience = _PATIENCE
        self._is_first = True
        self._version: object = UNKNOWN

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, error: BaseException | None, _where: TracebackType | None
    ) -> None:
        self._stream.close()
        self._sock.close()
        if isinstance(error, NOT_UNDERSTOOD):
            what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            told = DaemonError(f"the gateway's answer is not understood ({what}); {self._advice}")
            for note in getattr(error, "__notes__", ()):
                told.add_note(note)
            raise told from error

    @property
    def _advice(self) -> str:
        """What to do about an answer that is not understood."""
        if self._version == __version__:
            return f"both have version {__version__}: please report this defect"
        return f"the gateway has version {self._version}, this command {__version__}: restart the service"

    def wait_for(self, seconds: float) -> None:
        """Allow this time for an answer, if it is longer than the usual one."""
        self._patience = max(_PATIENCE, seconds)
        self._sock.settimeout(self._patience)

    @property
    def pid(self) -> int:
        """The process of the gateway."""
        pid, _user, _group = _PEER.unpack(self._sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
        return int(pid)

    def ask(self, verb: str, **details: object) -> dict[str, Any]:
        """The gateway's answer to a request."""
        with suppress(ConnectionError, TimeoutError):  # it has closed the connection, perhaps after an error message
            self._sock.sendall(json.dumps({"verb": verb, **details}).encode() + b"\n")
        return self.next_answer()

    def next_answer(self) -> dict[str, Any]:
        """The gateway's next answer, where a request has several."""
        try:
            line = self._stream.readline()
        except TimeoutError:
            raise DaemonError(f"the gateway did not answer within {self._patience:g} s") from None
        except ConnectionError:
            line = b""
        if not line:
            raise DaemonError("the gateway closed the connection before it answered; is it stopping?")
        was_first, self._is_first = self._is_first, False
        answer = _read_answer(line, compares=was_first)
        self._version = answer.get("version", UNKNOWN)
        return answer


def _read_answer(line: bytes, *, compares: bool = True) -> dict[str, Any]:
    try:
        answer: dict[str, Any] = json.loads(line)
        error = answer.get("error")
    except (ValueError, AttributeError):
        raise DaemonError("what answers there is not modbus-gateway") from None
    if compares:
        _compare_versions(answer.get("version", "an earlier one"))
    if error is not None:
        raise DaemonError(f"the gateway says: {error}")
    return answer


def _compare_versions(daemon: object) -> None:
    if daemon != __version__:
        remedy = "restart the gateway if this command was upgraded"
        print(f"versions differ: the gateway has {daemon}, this command {__version__}: {remedy}", file=sys.stderr)


def _connect(control: str | None) -> socket.socket:
    """A connection to the first gateway that answers."""
    reasons: list[str] = []
    forbidden: list[Path] = []
    paths = [Path(control)] if control else [*_read_config(reasons), control_path(Path("gateway.toml")), SYSTEM_SOCKET]
    for path in dict.fromkeys(paths):
        sock = socket.socket(socket.AF_UNIX)
        sock.settimeout(_PATIENCE)
        try:
            sock.connect(str(path))
        except OSError as error:
            sock.close()
            if isinstance(error, PermissionError):
                forbidden.append(path)
            reasons.append(f"{path}: {error.strerror or error}")
        else:
            return sock
    if forbidden:
        raise DaemonError(f"only root, the gateway's user and its group may use {forbidden[0]}: use sudo")
    raise DaemonError(f"no running gateway found ({'; '.join(reasons)}); --control PATH says where its socket is")


def _read_config(reasons: list[str]) -> list[Path]:
    """The socket in the service's config, if set. Why the config cannot be read is added to `reasons`."""
    try:
        config = tomllib.loads(Path(DEFAULT_CONFIG).read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        return []
    except (OSError, ValueError, RecursionError) as error:
        reasons.append(f"{DEFAULT_CONFIG}: cannot be read: {error}")
        return []
    match config:
        case {"control": {"socket": str(path)}}:
            return [Path(path)]
    return []
