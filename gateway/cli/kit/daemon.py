"""Requests to a running gateway through its control socket."""

import argparse
import json
import os
import socket
import struct
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Final, NamedTuple, Self, TypeVar

from gateway.cli.main import DEFAULT_CONFIG
from gateway.config.machine.file_text import UnreadableFile, folder_of, read_file_text
from gateway.config.machine.included import written_in
from gateway.control.messages import line_of, question_of, result_in
from gateway.control.path import SYSTEM_SOCKET, control_path
from gateway.errors import DaemonError
from gateway.operator.operations.operation import Nothing, Operation
from gateway.operator.operations.results import NotUnderstoodError
from gateway.operator.operations.table import WHICH
from gateway.version import __version__

P = TypeVar("P")
R = TypeVar("R")

#: The environment variable that names the control socket.
CONTROL_VARIABLE: Final = "MODBUS_GATEWAY_CONTROL"

#: How long the gateway may take to answer, in seconds. A reload may need 60 to read the file, 15 to look up names, 3
#: for requests in progress, and 1.5 to close ports.
_PATIENCE: Final = 90.0
#: `struct ucred`: the process at the other end of a socket, its user and group.
_PEER: Final = struct.Struct("=3i")
#: The version of a gateway that does not say it.
UNKNOWN: Final = "unknown"
#: What an answer in an unexpected form raises where it is taken apart or shown.
NOT_UNDERSTOOD: Final = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, struct.error)


def add_control_argument(parser: argparse.ArgumentParser) -> None:
    """Add `--control` and `--config`, by which the user says which gateway is meant."""
    usual = f"${CONTROL_VARIABLE}, else {SYSTEM_SOCKET}; without root $XDG_RUNTIME_DIR/modbus-gateway/control.sock"
    add = parser.add_argument
    add("--control", metavar="PATH", help=f"control socket of the gateway that is meant (default: {usual})")
    add("--config", metavar="FILE", help="config of the gateway that is meant, which says where its control socket is")


class Meant(NamedTuple):
    """The gateway that is meant: the one at this control socket. If it has a `config`, it must run with that one."""

    socket: Path
    config: Path | None = None


def which_gateway(args: argparse.Namespace, environment: Mapping[str, str] = os.environ) -> Meant:
    """Find which gateway the arguments mean. No other one is asked, whether this one answers or not.

    Raises:
        DaemonError: the config that should name it cannot be read.
    """
    if args.control:
        return Meant(Path(args.control))
    if args.config:
        return _gateway_of(Path(args.config), environment)
    return Meant(usual_socket(environment))


def usual_socket(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the control socket of the gateway that is meant where none is named."""
    return Path(environment.get(CONTROL_VARIABLE) or control_path(Path(DEFAULT_CONFIG), environment))


def _gateway_of(file: Path, environment: Mapping[str, str]) -> Meant:
    """Find the gateway with this config. Without a socket in it, another one may be at the usual place."""
    try:
        _check_tables(read_file_text(file))
    except (UnreadableFile, ValueError, RecursionError) as wrong:
        raise DaemonError(f"{file}: {wrong}; --control PATH says where the gateway's socket is") from None
    path, there = written_in(file, "control", "socket")
    if path:
        return Meant(folder_of(there) / path)
    return Meant(control_path(file, environment), file)


def _check_tables(text: str) -> None:
    """Check that a config is TOML. Of one that names no socket it does not matter: its gateway can say what is wrong.

    Raises:
        ValueError, RecursionError: it is no TOML.
    """
    import tomllib  # noqa: PLC0415 - only for --config

    try:
        tomllib.loads(text)
    except (ValueError, RecursionError):
        if "control" in text:
            raise


def tell_which(gateway: Path) -> None:
    """Say which gateway is asked to change something, by its control socket, beside the output for programs."""
    print(f"through {gateway}", file=sys.stderr)


class GatewayGoneError(DaemonError):
    """The gateway has closed the connection."""


class Conversation:
    """A connection to the gateway for any number of requests; open inside the context.

    Answers are shown inside the context: one of another form, as a gateway of another version may give it, becomes a
    DaemonError there with the same notes.

    Raises:
        DaemonError: no gateway can be reached, or it does not answer, or refuses a request.
    """

    def __init__(self, meant: Meant) -> None:
        self.gateway = meant.socket
        self._sock = _connect(meant.socket)
        self._stream = self._sock.makefile("rb")
        self._patience = _PATIENCE
        self._is_first = True
        self._version: object = UNKNOWN
        if meant.config is not None:
            self._must_run_with(meant.config)

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

    def _must_run_with(self, config: Path) -> None:
        """Leave a gateway that runs with another config."""
        try:
            told = self.ask(WHICH, Nothing()).config
        except (DaemonError, NotUnderstoodError):  # it has an earlier version, which does not say it
            return
        if os.path.realpath(told) != os.path.realpath(config):
            self._stream.close()
            self._sock.close()
            raise DaemonError(f"the gateway at {self.gateway} runs with {told}, not with {config}")

    @property
    def _advice(self) -> str:
        """Say what to do about an answer that is not understood."""
        if self._version == __version__:
            return f"both have version {__version__}: please report this defect"
        return f"the gateway has version {self._version}, this command {__version__}: restart the service"

    def wait_for(self, seconds: float) -> None:
        """Allow this time for an answer, if it is longer than the usual one."""
        self._patience = max(_PATIENCE, seconds)
        self._sock.settimeout(self._patience)

    @property
    def pid(self) -> int:
        """Return the process of the gateway."""
        pid, _user, _group = _PEER.unpack(self._sock.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size))
        return int(pid)

    def ask(self, operation: Operation[P, R], asked: P) -> R:
        """Ask an operation that has one answer."""
        return result_in(operation, self.ask_for_json(operation, asked))

    def answers(self, operation: Operation[P, R], asked: P) -> Iterator[R]:
        """Ask an operation that has several answers, and give them as they come."""
        for answer in self.answers_in_json(operation, asked):
            yield result_in(operation, answer)

    def ask_for_json(self, operation: Operation[P, Any], asked: P) -> dict[str, Any]:
        """Ask an operation that has one answer, and return it as the gateway tells it."""
        self._send(question_of(operation, asked))
        return self._receive()

    def answers_in_json(self, operation: Operation[P, Any], asked: P) -> Iterator[dict[str, Any]]:
        """Ask an operation that has several answers, and give them as the gateway tells them."""
        self._send(question_of(operation, asked))
        while not (answer := self._receive()).get("end"):
            yield answer

    def _send(self, question: Mapping[str, Any]) -> None:
        with suppress(ConnectionError, TimeoutError):  # it has closed the connection, perhaps after an error message
            self._sock.sendall(line_of(question))

    def _receive(self) -> dict[str, Any]:
        try:
            line = self._stream.readline()
        except TimeoutError:
            raise DaemonError(f"the gateway did not answer within {self._patience:g} s") from None
        except ConnectionError:
            line = b""
        if not line:
            raise GatewayGoneError("the gateway closed the connection before it answered; is it stopping?")
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


def _connect(path: Path) -> socket.socket:
    """Connect to the gateway at this socket.

    Raises:
        DaemonError: it does not answer there.
    """
    sock = socket.socket(socket.AF_UNIX)
    sock.settimeout(_PATIENCE)
    try:
        sock.connect(str(path))
    except OSError as error:
        sock.close()
        raise DaemonError(_why_not(path, error)) from error
    return sock


def _why_not(path: Path, error: OSError) -> str:
    """Say why no gateway answers at a socket, and how another one is named."""
    if isinstance(error, PermissionError):
        remedy = "use sudo" if path == SYSTEM_SOCKET else f"use sudo, with --control {path}"
        return f"only root, the gateway's user and its group may use {path}: {remedy}"
    others = "--control PATH or --config FILE names another one"
    if path != SYSTEM_SOCKET and SYSTEM_SOCKET.exists():
        others += f", and --control {SYSTEM_SOCKET} that of the service"
    return f"no running gateway found ({path}: {error.strerror or error}); {others}"
