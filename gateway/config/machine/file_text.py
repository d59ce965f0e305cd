"""Reads the text of a config file, says from where the paths in it count, and whether the service may read it."""

import os
import stat
from pathlib import Path
from typing import Final

from gateway.config.problem import Problem, error, warning

#: The largest config, in bytes: a unit of a line is written in 100.
MOST_BYTES: Final = 1024 * 1024
#: What a path may lead to instead of a file, by the letter that `ls -l` shows for it.
_NO_FILES: Final = {"p": "a FIFO", "d": "a directory", "c": "a device", "b": "a device", "s": "a socket"}
#: Where the config of the service is.
SERVICE_CONFIG: Final = Path("/etc/modbus-gateway")


class UnreadableFile(Exception):  # noqa: N818 - it is the file that is wrong, not the program
    """A file that cannot be read as text: why, what to do, and in which line (0 if it has no text)."""

    def __init__(self, what: str, remedy: str = "", line: int = 0) -> None:
        super().__init__(what)
        self.remedy = remedy
        self.line = line

    def problem(self, file: str | Path, remedy: str | None = None) -> Problem:
        """Make it a problem of this file."""
        found = error((), str(self), self.remedy if remedy is None else remedy)
        return found.located(str(file), self.line, min(self.line, 1))


def folder_of(file: Path) -> Path:
    """Find the folder from which paths in a config count: where it stands, not where a link to it may lead."""
    return file.parent.resolve()


def read_file_text(path: Path) -> str:
    """Read the text of a config file, with the line ends of Unix, and no byte order mark.

    Raises:
        UnreadableFile: it cannot be read.
    """
    try:
        return plain_text(read_file_bytes(path).decode())
    except UnicodeDecodeError as wrong:
        line = wrong.object.count(b"\n", 0, wrong.start) + 1
        raise UnreadableFile("this line is not UTF-8 text", "save the file as UTF-8", line) from None


def plain_text(text: str) -> str:
    """Give a text the line ends of Unix, and no byte order mark."""
    return text.removeprefix("\ufeff").replace("\r\n", "\n")


def find_wrong_text(text: str) -> str:
    """Say why a text cannot be a config file; empty if it can."""
    try:
        size = len(text.encode())
    except UnicodeEncodeError:
        return "is not UTF-8 text"
    return f"has more than {MOST_BYTES} bytes" if size > MOST_BYTES else ""


def read_file_bytes(path: Path) -> bytes:
    """Read a file of limited size.

    Raises:
        UnreadableFile: it cannot be read. What is no file is not opened: a FIFO would never end.
    """
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):
            raise UnreadableFile(f"is {_NO_FILES[stat.filemode(mode)[0]]}, not a file", "name a file")
        with path.open("rb") as stream:
            content = stream.read(MOST_BYTES + 1)
    except FileNotFoundError:
        raise UnreadableFile("there is no such file", "create it, or name another file") from None
    except OSError as wrong:
        remedy = f"sudo chmod 644 {path}" if isinstance(wrong, PermissionError) else ""
        raise UnreadableFile(f"cannot be read: {os.strerror(wrong.errno or 0)}", remedy) from None
    if len(content) > MOST_BYTES:
        raise UnreadableFile(f"has more than {MOST_BYTES} bytes", "is it the right file?")
    return content


def file_trouble(path: str, folder: Path = SERVICE_CONFIG) -> Problem | None:
    """Warn of a file in the service's `folder` that not all users may read: the service has its own user."""
    file = Path(path).absolute()
    if file.parent != folder or file.stat().st_mode & stat.S_IROTH:
        return None
    return warning((), "the service may not be able to read this file", f"sudo chmod 644 {file}").located(path, 0, 0)
