"""`support`: a diagnostics bundle in one file, of the running gateway and of this machine."""

import argparse
import os
import platform
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.cli.kit.daemon import Conversation, add_control_argument, which_gateway
from gateway.cli.kit.progress import Progress, progress
from gateway.cli.main import DEFAULT_CONFIG, FINE
from gateway.cli.show.check import check_as_text
from gateway.config.load import load
from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.machine.included import files_of
from gateway.config.machine.troubles import address_trouble
from gateway.config.reading.masking import secrets_in
from gateway.control.path import folder_of_control
from gateway.errors import ConfigError, DaemonError
from gateway.operator.operations.asked import ToSupport
from gateway.operator.operations.operation import Nothing
from gateway.operator.operations.results import NotUnderstoodError
from gateway.operator.operations.table import SUPPORT, WHICH
from gateway.readconfig.file_troubles import with_file_troubles
from gateway.state.memory import state_folder
from gateway.tools.bundle import TRACE, Bundle
from gateway.tools.machine import documents_of_machine, without_advice

#: Longer than the gateway takes for any document, in seconds.
_PATIENCE: Final = 80.0
#: Only who made the file may read it.
_MODE: Final = 0o600

_ABOUT: Final = """\
Nothing is sent on any line. Passwords, tokens and keys of the config are not
in the file, nor are its comments. Names, addresses and the log are, and
without --no-trace the values that passed in the last five minutes.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `support`."""
    parser.epilog = _ABOUT
    add = parser.add_argument
    add("file", metavar="FILE", help="the file to write, such as bundle.tar.gz")
    add("--no-trace", action="store_true", help="leave out what passed on the lines: it has values of the process")
    add("--force", action="store_true", help="replace the file if it exists")
    add_control_argument(parser)


def run(args: argparse.Namespace) -> int:
    """Write the bundle, and say what is in it and what is missing."""
    file = Path(args.file)
    if os.path.lexists(file) and not args.force:
        raise ConfigError(f"{file} exists; name another file, or replace it with --force")
    bundle = Bundle()
    with progress() as line:
        config = _ask_gateway(args, bundle, line)
        for each in documents_of_machine(config, state_folder(), lambda: _check(config)):
            line.show(each.name)
            bundle.add(each)
        packed = bundle.packed(_secrets(config), platform.node(), time.time())
        _write(file, packed, force=args.force)
    print(f"{file}: {len(bundle.names)} documents, {len(packed) // 1024 + 1} KiB")
    for name, why in bundle.missing.items():
        print(f"  without {name}: {why}")
    if TRACE in bundle.names:
        print("It has values that passed on the lines (trace.jsonl); --no-trace leaves them out.")
    return FINE


def _ask_gateway(args: argparse.Namespace, bundle: Bundle, line: Progress) -> Path:
    """Add what the gateway tells, or why nothing, and return its config file."""
    config = Path(args.config or DEFAULT_CONFIG)
    try:
        with Conversation(which_gateway(args)) as daemon:
            with suppress(NotUnderstoodError):
                config = Path(daemon.ask(WHICH, Nothing()).config)
            daemon.wait_for(_PATIENCE)
            for document in daemon.answers(SUPPORT, ToSupport(trace=not args.no_trace)):
                line.show(f"the gateway: {document.name}")
                bundle.add(document)
    except DaemonError as error:
        bundle.missing["the running gateway"] = str(error)
    return config


def _check(config: Path) -> str:
    """Return what `check` says, without the advice what to write instead."""
    loaded = with_file_troubles(load(config, address_trouble=address_trouble), str(config))
    plan = loaded.plan
    folder = folder_of_control(config, None if plan is None else plan.control)
    return check_as_text(replace(loaded, problems=without_advice(loaded.problems)), plan, folder) + "\n"


def _secrets(config: Path) -> set[str]:
    found = set[str]()
    for file in files_of(config):
        with suppress(UnreadableFile):
            found |= secrets_in(read_file_text(file))
    return found


def _write(file: Path, content: bytes, *, force: bool) -> None:
    """Write the file for its maker only. What is there is replaced with `force` only, and then as a whole.

    Raises:
        ConfigError: it cannot be written.
    """
    fresh = file.with_name(f"{file.name}.new") if force else file
    try:
        _write_new(fresh, content)
        if force:
            fresh.replace(file)
    except OSError as error:
        raise ConfigError(f"{file} cannot be written: {error.strerror}") from error


def _write_new(file: Path, content: bytes) -> None:
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, _MODE)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
    except BaseException:
        file.unlink()
        raise
