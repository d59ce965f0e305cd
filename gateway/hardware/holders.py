"""Which program uses a serial port, as far as this user may see."""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from gateway.hardware.device_files import VIRTUAL_MAJORS

PROC: Final = Path("/proc")
#: The other ends of pseudo-terminals.
_FAR_ENDS: Final = frozenset({"/dev/ptmx", "/dev/pts/ptmx"})
#: Programs that run another one, which their arguments name.
_INTERPRETER: Final = re.compile(r"(python|pypy|perl|ruby)[\d.]*|(ba|da|z)?sh|node|java")
_GATEWAY: Final = "modbus-gateway"
_GATEWAY_MODULE: Final = "-m gateway.cli.main"


def find_holder(device: str) -> str | None:
    """Name a program that uses the device, as `mbusd (pid 412)`; None if there is none, or none that may be seen.

    Only root may see other users' descriptors. Everybody may see locks, and most serial programs set one.
    """
    for pid in (*_find_by_lock(Path(device), PROC), *_find_by_descriptor(Path(device), PROC)):
        if pid != os.getpid():
            return f"{name_program(pid, PROC)} (pid {pid})"
    return None


def find_holders(device: Path, programs: Path = PROC) -> set[int]:
    """Find the programs that hold the device, by pid, as far as they may be seen; not one that simulates it."""
    by_descriptor = (
        pid for pid in _find_by_descriptor(device, programs) if not _has_other_end(device, programs / str(pid))
    )
    return {*_find_by_lock(device, programs), *by_descriptor}


def list_programs(programs: Path = PROC) -> set[str]:
    """List the names of all programs that run."""
    return {name_program(int(process.name), programs) for process in programs.glob("[1-9]*")}


def name_program(pid: int, programs: Path = PROC) -> str:
    """Name a program, cut after 15 characters; an interpreter with what it runs, as `python poll.py`."""
    try:
        name = (programs / str(pid) / "comm").read_text().strip()
    except OSError:
        return "a program"
    if not is_interpreter(name):
        return name
    arguments = ""
    with suppress(OSError):  # it has just ended
        arguments = (programs / str(pid) / "cmdline").read_text(errors="replace")
    runs = _find_script(arguments.split("\0")[1:])
    is_gateway = runs == _GATEWAY_MODULE or Path(runs).name == _GATEWAY
    return _GATEWAY if is_gateway else f"{name} {runs}".rstrip()


def is_interpreter(name: str) -> bool:
    """Tell by its name, alone or with what it runs, whether a program is one that runs others."""
    return _INTERPRETER.fullmatch(name.partition(" ")[0]) is not None


def _find_script(arguments: Iterable[str]) -> str:
    """Find the module or file that an interpreter runs; not what follows, where passwords may be."""
    rest = iter(arguments)
    for argument in rest:
        if argument == "-m":
            return f"-m {next(rest, '')}"
        if argument in {"-c", "-e"}:
            return argument
        if argument in {"-W", "-X"}:
            next(rest, "")
        elif not argument.startswith("-"):
            return argument
    return ""


def _find_by_lock(device: Path, programs: Path = PROC) -> Iterator[int]:
    with suppress(OSError):
        node = device.stat()
        place = f"{os.major(node.st_dev):02x}:{os.minor(node.st_dev):02x}:{node.st_ino}"
        for line in (programs / "locks").read_text().splitlines():
            match line.split():
                case [_, "FLOCK", _, _, pid, lock, *_] if lock == place:
                    yield int(pid)


def _find_by_descriptor(device: Path, programs: Path) -> Iterator[int]:
    with suppress(OSError):
        node = device.stat()
        for process in programs.glob("[1-9]*"):
            found = (number for number, opened in _list_descriptors(process) if opened == device)
            if any(_leads_to(node, process / "fd" / number) for number in found):
                yield int(process.name)


def _leads_to(node: os.stat_result, descriptor: Path) -> bool:
    """Tell whether a descriptor is of this device. A container has pseudo-terminals of its own, with the same names."""
    with suppress(OSError):  # it has just been closed
        opened = descriptor.stat()
        is_here = opened.st_dev == node.st_dev or os.major(node.st_rdev) not in VIRTUAL_MAJORS
        return is_here and opened.st_rdev == node.st_rdev
    return False


def _has_other_end(device: Path, process: Path) -> bool:
    """Tell whether a program has the other end of a pseudo-terminal: then it is the device, and does not hold it."""
    for number, opened in _list_descriptors(process):
        if str(opened) in _FAR_ENDS:
            with suppress(OSError):  # it has just closed it
                told = (process / "fdinfo" / number).read_text().split()
                if told[told.index("tty-index:") + 1] == device.name:
                    return True
    return False


def _list_descriptors(process: Path) -> Iterator[tuple[str, Path]]:
    """List a program's descriptors: the number of each, and what it leads to."""
    with suppress(OSError):  # another user's process, or one that has just ended
        for descriptor in (process / "fd").iterdir():
            with suppress(FileNotFoundError):  # it has just closed it
                yield descriptor.name, descriptor.readlink()
