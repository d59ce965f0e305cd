"""Late answers that outlive the line that has asked: they come on its port, whatever line or process is there then.

    {"/dev/ttyS1": {"at": 812.4, "answers": [
        {"unit": 1, "answers_from": 1, "pdu": "03 00 07 00 01", "owed": 1, "ends_at": 814.1}
    ]}}

A line on this port has ended 812.4 s after the machine was started, and answers to this question may have come until
814.1 s. After another start its clock is behind that: then the answers count from that start, and are as old or older.
Where the clock has passed it already, they wait no longer than they would have had to.
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

#: No late window is longer, in seconds: an entry that says so is damaged.
LONGEST: Final = 86_400.0
UNITS: Final = range(256)

_PSEUDO_TERMINALS: Final = Path("/dev/pts")

Entry = dict[str, Any]


class LeftBehind:
    """Answers that lines have left behind on their ports; with a `file` also for the next process.

    Ports go by their `place`. All times are in seconds of the machine's monotonic clock, as those of the event loop.
    """

    def __init__(self, file: SharedFile | None = None) -> None:
        self._file = file
        self._left_at: set[str] = set()
        self._entries: Entries = {} if file is None else file.read()

    def at(self, place: str, now: float) -> list[Overdue]:
        """What may still come there."""
        entry = self._entries.get(place)
        if entry is None:
            return []
        later = -entry["at"] if entry["at"] > now else 0.0
        return [each for answer in entry["answers"] if (each := _overdue(answer, later)).ends_at > now]

    def leave(self, place: str, answers: Sequence[Overdue], now: float) -> None:
        """A line has ended there, and only these answers are overdue.

        What is past is forgotten wherever lines of this process have ended: other ports may be another gateway's, which
        has written anew what we have read.
        """
        self._left_at.add(place)
        for there in self._left_at.intersection(self._entries):
            if there == place or not self.at(there, now):
                del self._entries[there]
                self._write(there, None)
        if answers:
            written = [each._asdict() | {"pdu": each.pdu.hex(" ")} for each in answers]
            self._entries[place] = {"at": now, "answers": written}
            self._write(place, self._entries[place])

    def close(self) -> None:
        """Returns when the file has been written."""
        if self._file is not None:
            self._file.close()

    def _write(self, place: str, entry: Entry | None) -> None:
        if self._file is not None:
            self._file.change(place, entry)


def place_of(port: PortSettings) -> str:
    """The device that a port's name leads to at the moment, so that two names of one device have the same place.

    A device server goes by its host as written, apart from capital letters, and its port number. A pseudo-terminal
    counts with the time when it was made: the next one may get its number.
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
        sound = all(each.asked.function and each.unit in UNITS and each.owed > 0 for each in answers)
        longest = max((each.ends_at for each in answers), default=0.0) - value["at"]
        return bool(value["at"] >= 0) and longest < LONGEST and sound
    except (ArithmeticError, LookupError, TypeError, ValueError, RequestError):
        return False


def _overdue(answer: Entry, later: float) -> Overdue:
    return Overdue(**answer | {"pdu": bytes.fromhex(answer["pdu"]), "ends_at": answer["ends_at"] + later})
