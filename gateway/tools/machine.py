"""What a diagnostics bundle has of this machine, with or without a running gateway: config, ports, log, versions.

Nothing of it opens a port or sends anything. All of it blocks, each part for some seconds at most.
"""

import json
import os
import platform
import shutil
import subprocess
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from datetime import UTC, datetime
from importlib.metadata import distributions
from pathlib import Path
from typing import Final
from urllib.parse import quote

from gateway.config.machine.file_text import UnreadableFile, read_file_text
from gateway.config.machine.included import files_of
from gateway.config.machine.profile_folders import file_of, folders_of, names_in
from gateway.config.problem import Problem
from gateway.config.reading.masking import masked
from gateway.hardware.listing import describe_adapter, list_serial_ports
from gateway.operator.operations.answers.support import Document
from gateway.tools.hardware_report import about_machine

#: The most own profiles, entries of the state directory, and lines of the log.
MOST_PROFILES: Final = 100
MOST_ENTRIES: Final = 1000
MOST_LOG_LINES: Final = 2000
#: How long the journal may take, in seconds.
_JOURNAL_TIME: Final = 15.0
#: The unit of the service.
_UNIT: Final = "modbus-gateway.service"


def documents_of_machine(config: Path, state: Path, check: Callable[[], str]) -> Iterator[Document]:
    """Yield each document; of one that cannot be made, why not. `check` returns what `check` says of `config`.

    `state` is the state directory.
    """
    yield _made("versions.txt", _versions)
    yield _made("machine.txt", lambda: _machine(state))
    yield _made("ports.json", _ports)
    yield _made("config/gateway.toml", lambda: _masked(config))
    for file in files_of(config)[1:]:
        name = quote(os.path.relpath(file, config.parent), safe="")
        yield _made(f"config/include/{name}", lambda file=file: _masked(file))  # type: ignore[misc]
    for name, file in _own_profiles(config):
        yield _made(f"config/profiles/{name}.toml", lambda file=file: _masked(file))  # type: ignore[misc]
    yield _made("check.txt", check)
    yield _made("state.txt", lambda: _listing(state))
    yield _made("log.txt", _log)


def without_advice(problems: tuple[Problem, ...]) -> tuple[Problem, ...]:
    """Return problems without the advice what to write instead, which may repeat a value."""
    return tuple(replace(each, remedy="") for each in problems)


def _made(name: str, make: Callable[[], str]) -> Document:
    try:
        return Document(name, make())
    except (OSError, UnreadableFile) as error:
        return Document(name, missing=str(error))
    except (ValueError, RecursionError):
        return Document(name, missing="it is no TOML, so it is not known where its secrets are")


def _versions() -> str:
    libraries = sorted({f"{each.name} {each.version}" for each in distributions()}, key=str.lower)
    return "".join(f"{row.what}: {row.seen}\n" for row in about_machine()) + "\n" + "\n".join(libraries) + "\n"


def _machine(state: Path) -> str:
    """Show how long the machine runs, how busy it is, and what room it has."""
    rows = [f"time: {datetime.now(UTC).isoformat(timespec='seconds')}", f"host: {platform.node()}"]
    rows.append(f"processors: {os.cpu_count()}")
    for name in ("uptime", "loadavg"):
        with suppress(OSError):
            rows.append(f"{name}: {Path('/proc', name).read_text().strip()}")
    with suppress(OSError):
        rows += Path("/proc/meminfo").read_text().splitlines()[:5]
    with suppress(OSError):
        disk = shutil.disk_usage(state)
        rows.append(f"disk of {state}: {disk.free} bytes free of {disk.total}")
    return "\n".join(rows) + "\n"


def _ports() -> str:
    listed = [{**asdict(port), "adapter": asdict(describe_adapter(port.path))} for port in list_serial_ports()]
    return json.dumps(listed, indent=1, ensure_ascii=False) + "\n"


def _masked(file: Path) -> str:
    return masked(read_file_text(file))


def _own_profiles(config: Path) -> Iterator[tuple[str, Path]]:
    """Find the files of own profiles, the nearest of each."""
    found: dict[str, Path] = {}
    for folder in folders_of(config):
        with suppress(OSError):
            for name in names_in(folder):
                file = file_of(name, folder)
                if file is not None:
                    found.setdefault(name, file)
    yield from list(found.items())[:MOST_PROFILES]


def _listing(state: Path) -> str:
    """List the files of the state directory: bytes, time of the last change, name."""
    rows = [f"{state}"]
    for entry in sorted(state.rglob("*"))[:MOST_ENTRIES]:
        with suppress(OSError):
            status = entry.lstat()
            changed = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds")
            rows.append(f"{status.st_size:>12}  {changed}  {entry.relative_to(state)}")
    if not state.exists():
        rows.append("does not exist")
    return "\n".join(rows) + "\n"


def _log() -> str:
    """Read the last lines of the service's log.

    Raises:
        OSError: the journal cannot be read; the message says why.
    """
    program = shutil.which("journalctl")
    if program is None:
        raise OSError("there is no journalctl here: the log is where the gateway's standard error goes")
    words = [program, "--unit", _UNIT, "--lines", str(MOST_LOG_LINES), "--output", "short-iso", "--no-pager", "--quiet"]
    try:
        told = subprocess.run(words, capture_output=True, timeout=_JOURNAL_TIME, check=False)  # noqa: S603 - no shell
    except subprocess.TimeoutExpired:
        raise OSError(f"journalctl has not ended within {_JOURNAL_TIME:g} s") from None
    if told.returncode or not told.stdout:
        said = told.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise OSError(
            said or f"the journal has nothing of {_UNIT} that this user may read; is it the service? use sudo"
        )
    return told.stdout.decode(errors="replace")
