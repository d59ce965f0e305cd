"""Late answers that outlive the line that has asked: they come on its port, whatever line or process is there then.

    {"/dev/ttyS1": {"boot": "3c1f...", "at": 812.4, "answers": [
        {"unit": 1, "answers_from": 1, "pdu": "03 00 07 00 01", "owed": 1, "ends_at": 814.1}
    ]}}

A line on this port has ended 812.4 s after the machine was started, and answers to this question may have come until
814.1 s.
"""

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from gateway.errors import RequestError
from gateway.lines.late import Overdue
from gateway.ports.port import PortSettings, TcpSettings
from gateway.service.shared_file import Entries, SharedFile

FILE_NAME: Final = "late.json"

#: Another one after each start of the machine, when its clock begins anew.
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")

_PSEUDO_TERMINALS: Final = Path("/dev/pts")

Entry = dict[str, Any]


class LeftBehind:
    """Answers that lines have left behind on their ports; with a `file` also for the next process.

    Ports go by their `place`. All times are in seconds of the machine's monotonic clock, as those of the event loop.
    """

    def __init__(self, file: SharedFile | None = None) -> None:
        self._file = file
        self._boot = _boot_id()
        self._entries: Entries = {} if file is None else file.read_or_move_aside()

    def at(self, place: str, now: float) -> list[Overdue]:
        """What may still come there."""
        entry = self._entries.get(place)
        if entry is None:
            return []
        # An entry of before the machine was started is as old as that, or older.
        later = min(0.0, now - entry["at"]) if entry["boot"] == self._boot else -entry["at"]
        return [each for answer in entry["answers"] if (each := _overdue(answer, later)).ends_at > now]

    def leave(self, place: str, answers: Sequence[Overdue], now: float) -> None:
        """A line has ended there, and only these answers are overdue. What is past is forgotten, wherever it was."""
        for there in [each for each in self._entries if each == place or not self.at(each, now)]:
            del self._entries[there]
            self._write(there, None)
        if answers:
            written = [each._asdict() | {"pdu": each.pdu.hex(" ")} for each in answers]
            self._entries[place] = {"boot": self._boot, "at": now, "answers": written}
            self._write(place, self._entries[place])

    def close(self) -> None:
        """Returns when the file has been written."""
        if self._file is not None:
            self._file.close()

    def _write(self, place: str, entry: Entry | None) -> None:
        if self._file is not None:
            self._file.change(place, entry)


def place_of(port: PortSettings) -> str:
    """The device that a port's name leads to at the moment, or the server: two names of one port have the same.

    A pseudo-terminal counts with the time when it was made: the next one may get its number.
    """
    if isinstance(port, TcpSettings):
        return f"{port.host.lower()}:{port.number}"
    device = Path(os.path.realpath(port.port))
    if device.parent == _PSEUDO_TERMINALS:
        with suppress(OSError):
            return f"{device} of {device.stat().st_ctime_ns}"
    return str(device)


def is_entry(value: Any) -> bool:
    """Whether this can be an entry of the file."""
    try:
        answers = [_overdue(answer, 0.0) for answer in value["answers"]]
        sound = all(each.asked.function and each.unit >= 0 and each.owed > 0 for each in answers)
        return isinstance(value["boot"], str) and value["at"] >= 0 and sound
    except (LookupError, TypeError, ValueError, RequestError):
        return False


def _overdue(answer: Entry, later: float) -> Overdue:
    return Overdue(**answer | {"pdu": bytes.fromhex(answer["pdu"]), "ends_at": answer["ends_at"] + later})


def _boot_id() -> str:
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:  # then an entry of before is taken for one of now, and some seconds are waited for nothing
        return ""
