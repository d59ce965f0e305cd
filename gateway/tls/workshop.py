"""The folder of an authority, and the program `openssl`, which creates the certificates there.

(The library `cryptography` needs cffi, which has no wheel for armv7l; `openssl` is installed on every machine.)
"""

import fcntl
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Self

from gateway.errors import TlsError

#: The stem of an authority's files.
AUTHORITY: Final = "ca"
#: The limit of one step of openssl, in seconds: after a start, a small machine has little randomness.
DEADLINE: Final = 60.0
#: How long to wait for another command in the same folder, and the time between checks, in seconds.
TURN_WITHIN: Final = 30.0
_LOOK_EVERY: Final = 0.05


def find_authority(folder: Path) -> tuple[Path, Path]:
    """Return the paths of the certificate and the key of the authority in `folder`.

    Raises:
        TlsError: one of them is missing.
    """
    certificate, key = folder / f"{AUTHORITY}.crt", folder / f"{AUTHORITY}.key"
    for file in (certificate, key):
        if not file.exists():
            raise TlsError(f"{file}: there is no authority; make one first: modbus-gateway certificates authority")
    return certificate.absolute(), key.absolute()


@contextmanager
def lock_folder(folder: Path) -> Iterator[None]:
    """Lock `folder` against other commands, in this context. It is created if necessary.

    Raises:
        TlsError: another command keeps it locked for TURN_WITHIN, or it cannot be opened.
    """
    try:
        folder.mkdir(mode=0o755, parents=True, exist_ok=True)
        descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except OSError as error:
        raise _make_error(folder, error) from error
    try:
        _wait_for_turn(folder, descriptor)
        yield
    finally:
        os.close(descriptor)


def _wait_for_turn(folder: Path, descriptor: int) -> None:
    deadline = time.monotonic() + TURN_WITHIN
    while True:
        try:
            return fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            if time.monotonic() >= deadline:
                raise TlsError(f"{folder}: another command is still at work there; try again later") from error
        except OSError as error:
            raise _make_error(folder, error) from error
        time.sleep(_LOOK_EVERY)


def _make_error(folder: Path, error: OSError) -> TlsError:
    return TlsError(f"{folder}: {(error.strerror or str(error)).lower()}")


class Workshop:
    """A temporary folder for new files, beside their destination."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> Self:
        if shutil.which("openssl") is None:
            raise TlsError("the program openssl was not found. On Debian: apt install openssl")
        try:
            self._temporary = tempfile.TemporaryDirectory(prefix=".new-", dir=self._folder)
        except OSError as error:
            raise _make_error(self._folder, error) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._temporary.cleanup()

    def place(self, name: str) -> str:
        """Return the path of a file in the temporary folder."""
        return str(Path(self._temporary.name, name).absolute())

    def settings(self, name: str, extensions: Mapping[str, str]) -> str:
        """Write a settings file for openssl. Return its path."""
        lines = [
            "[req]\nprompt=no\nutf8=yes\ndistinguished_name=subject",
            f"[subject]\nCN={name}",
            "[extensions]",
            *(f"{key}={value}" for key, value in extensions.items()),
        ]
        file = Path(self.place("settings"))
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return str(file)

    def openssl(self, *words: str) -> None:
        """Run `openssl WORDS` in the temporary folder; only its owner can read the files it creates.

        Raises:
            TlsError: it failed.
        """
        command = ["openssl", *words]
        try:
            done = subprocess.run(  # noqa: S603 - nothing in `words` is taken for an option or a command
                command,
                cwd=self._temporary.name,
                capture_output=True,
                text=True,
                timeout=DEADLINE,
                check=False,
                umask=0o077,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise TlsError(f"openssl {words[0]} failed: {error}") from error
        if done.returncode:
            *_, why = done.stderr.strip().splitlines() or ["no reason given"]
            raise TlsError(f"openssl {words[0]} failed: {why}")

    def deliver(self, files: Mapping[str, Path]) -> None:
        """Move the files to their destinations. All but keys are readable by everybody."""
        for name, place in files.items():
            made = Path(self.place(name))
            made.chmod(0o600 if name == "key" else 0o644)
            made.replace(place)
