"""The last configs that were in use, each in a folder of its own, from where a command can take it back.

    configs/000012-20261128T213005Z/gateway.toml
    configs/000012-20261128T213005Z/profiles/meter.toml
    configs/000012-20261128T213005Z/include/conf.d%2Fhall-b.toml

Only their owner can read them. A folder gets its name when all is in it, so no power cut leaves half a config. Numbers
give the order: clocks are set. Links are never followed: the owner of the state folder may have planted them.

All calls block.
"""

import errno
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import Final
from urllib.parse import quote, unquote

from gateway.events import Emit
from gateway.state.file_trouble import FileTrouble

FOLDER: Final = "configs"
#: The folder of the own profiles that a config uses, as beside the config itself.
PROFILES: Final = "profiles"
#: The folder of the files that a config includes; their names stand for paths.
INCLUDED: Final = "include"
#: How many are kept.
MOST: Final = 10

_NAME: Final = re.compile(r"([0-9]{6})-([0-9]{8}T[0-9]{6}Z)")
_TIME: Final = "%Y%m%dT%H%M%SZ"
_UNFINISHED: Final = ".new"
#: The largest file that is read, in bytes: a config may have 1 MiB.
_LARGEST: Final = 1 << 20
_FOLDER_ONLY: Final = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC


@dataclass(frozen=True, slots=True)
class AppliedConfig:
    """A config that was in use from the time `at` on; `file` is its path, `name` that of its folder.

    `profiles` are the texts of the own profiles that it used, by name, and `included` those of the files that it
    included, by their paths from the folder of the config.
    """

    name: str
    at: datetime
    file: Path
    text: str = field(repr=False)
    profiles: Mapping[str, str] = field(default_factory=dict, repr=False)
    included: Mapping[str, str] = field(default_factory=dict, repr=False)

    def included_file(self, path: str) -> Path:
        """Return where the text of an included file is kept."""
        return self.file.parent / INCLUDED / quote(path, safe="")


class AppliedConfigs:
    """The configs in a state folder. Trouble with writing is told by events, and ends nothing."""

    def __init__(self, state: Path, file_name: str, emit: Emit, clock: Callable[[], float] = time.time) -> None:
        self.folder = state / FOLDER
        self._file_name = file_name
        self._clock = clock
        self._trouble = FileTrouble(self.folder, emit)
        self._turn = Lock()

    def keep(self, text: str, profiles: Mapping[str, str], included: Mapping[str, str]) -> None:
        """Keep a config that is in use now, unless it is the last one that was kept."""
        try:
            with self._turn:
                self._keep(text, profiles, included)
        except OSError as error:
            self._trouble.failed(error)
        else:
            self._trouble.tell("")

    def names(self) -> list[str]:
        """List the names of all, the newest first; none of a folder that cannot be read."""
        try:
            with _opened(self.folder) as folder:
                return _names(folder)
        except OSError:
            return []

    def read(self, name: str) -> AppliedConfig | None:
        """Read one; None if it is not there, or cannot be read."""
        match = _NAME.fullmatch(name)
        if match is None:
            return None
        try:
            with _opened(self.folder) as folder, _opened(name, folder) as own:
                (file,) = (each for each in _listed(own) if each not in (PROFILES, INCLUDED))
                profiles = {each.removesuffix(".toml"): text for each, text in _read_all(own, PROFILES)}
                included = {unquote(each): text for each, text in _read_all(own, INCLUDED)}
                at = datetime.strptime(match[2], _TIME).replace(tzinfo=UTC)
                return AppliedConfig(name, at, self.folder / name / file, _read(own, file), profiles, included)
        except (OSError, ValueError):
            return None

    def _keep(self, text: str, profiles: Mapping[str, str], included: Mapping[str, str]) -> None:
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        with _opened(self.folder.parent.resolve()) as state, suppress(FileExistsError):
            _make_folder(state, FOLDER)
        with _opened(self.folder) as folder:
            names = _names(folder)
            last = self.read(names[0]) if names else None
            if last is not None and (last.text, last.profiles, last.included) == (text, profiles, included):
                return
            with suppress(FileNotFoundError):
                _remove(folder, _UNFINISHED)
            _make_folder(folder, _UNFINISHED)
            with _opened(_UNFINISHED, folder) as new:
                _write(new, self._file_name, text)
                _write_all(new, PROFILES, {f"{name}.toml": each for name, each in profiles.items()})
                _write_all(new, INCLUDED, {quote(path, safe=""): each for path, each in included.items()})
                os.fsync(new)
            number = int(_NAME.fullmatch(names[0])[1]) + 1 if names else 1  # type: ignore[index]
            at = datetime.fromtimestamp(self._clock(), UTC).strftime(_TIME)
            os.rename(_UNFINISHED, f"{number:06}-{at}", src_dir_fd=folder, dst_dir_fd=folder)
            os.fsync(folder)
            for name in names[MOST - 1 :]:
                _remove(folder, name)


def _write_all(within: int, name: str, texts: Mapping[str, str]) -> None:
    """Make a folder of files with these texts, if there are any."""
    if texts:
        _make_folder(within, name)
        with _opened(name, within) as inner:
            for file, each in texts.items():
                _write(inner, file, each)
            os.fsync(inner)


def _names(folder: int) -> list[str]:
    return sorted(filter(_NAME.fullmatch, _listed(folder)), reverse=True)


def _listed(folder: int) -> list[str]:
    return os.listdir(folder)


def _read_all(within: int, name: str) -> Iterator[tuple[str, str]]:
    with suppress(FileNotFoundError), _opened(name, within) as inner:
        for file in sorted(_listed(inner)):
            yield file, _read(inner, file)


@contextmanager
def _opened(path: Path | str, within: int | None = None) -> Iterator[int]:
    """Open a folder, which is no link, as a descriptor inside the context."""
    descriptor = os.open(path, _FOLDER_ONLY, dir_fd=within)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _make_folder(within: int, name: str) -> None:
    os.mkdir(name, 0o700, dir_fd=within)
    _give_to_owner(within, name)


def _read(folder: int, name: str) -> str:
    descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=folder)
    with os.fdopen(descriptor, "rb") as stream:
        content = stream.read(_LARGEST + 1)
    if len(content) > _LARGEST:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG))
    return content.decode()


def _write(folder: int, name: str, text: str) -> None:
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    with os.fdopen(os.open(name, flags, 0o600, dir_fd=folder), "wb") as stream:
        _give_to_owner(folder, name)
        stream.write(text.encode())
        stream.flush()
        os.fsync(stream.fileno())


def _remove(folder: int, name: str) -> None:
    try:
        shutil.rmtree(name, dir_fd=folder)
    except NotADirectoryError:
        os.unlink(name, dir_fd=folder)


def _give_to_owner(within: int, name: str) -> None:
    """Give what root has made to the owner of the folder around it, so that a service can use it afterwards."""
    if os.geteuid() == 0:
        with suppress(OSError):
            status = os.fstat(within)
            os.chown(name, status.st_uid, status.st_gid, dir_fd=within, follow_symlinks=False)
