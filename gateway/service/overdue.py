"""Late answers that outlive the line that has asked: they come on its port, whatever line or process is there then.

    {"/dev/ttyS1": {"boot": "3c1f...", "at": 812.4, "answers": [
        {"unit": 1, "answers_from": 1, "pdu": "03 00 07 00 01", "owed": 1, "ends_at": 814.1}
    ]}}

A line on this port has ended 812.4 s after the machine was started, and answers to this question may have come until
814.1 s. While a line is at work it is `{"boot": "3c1f...", "silence": 3.4}`: nobody knows what may come, so nothing is
asked for so many seconds. Only a gateway that was killed leaves that behind, or one that still had to be silent itself.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.errors import RequestError
from gateway.lines.late import Overdue
from gateway.ports.port import PortSettings, TcpSettings
from gateway.service.shared_file import Entries, SharedFile

FILE_NAME: Final = "late.json"

#: Another one after each start of the machine, when its clock begins anew.
_BOOT_ID: Final = Path("/proc/sys/kernel/random/boot_id")

Entry = dict[str, Any]


class Aftermath(NamedTuple):
    """What was left behind on a port: nothing must be asked before `silent_until`, and answers are `overdue`."""

    silent_until: float = 0.0
    overdue: tuple[Overdue, ...] = ()


class LeftBehind:
    """What lines leave behind on their ports; with a `file` also for the next process. Ports go by their `place`.

    All times are in seconds of the machine's monotonic clock, as those of the event loop. Behind a file that cannot be
    read, lines begin as if the last gateway had been killed.
    """

    def __init__(self, file: SharedFile | None = None) -> None:
        self._file = file
        self._boot = _boot_id()
        found = {} if file is None else file.read_or_move_aside()
        self._is_lost = found is None
        self._entries: Entries = found or {}
        self._silent_until: dict[str, float] = {}

    def begin(self, at: str, patience: float, now: float) -> Aftermath:
        """A line begins, to which late answers may come for so many seconds if it is killed. What was left for it."""
        missing = Aftermath(now + patience) if self._is_lost else Aftermath()
        found = self._aftermath(self._entries.pop(at), now) if at in self._entries else missing
        self._silent_until[at] = found.silent_until
        until = max(now + patience, found.silent_until, _last_end(found.overdue))
        self._keep(at, self._silence(until - now))
        return found

    def end(self, at: str, overdue: Sequence[Overdue], now: float) -> None:
        """A line ends, and these answers are overdue. One that had to be silent still leaves that behind."""
        silent_until = self._silent_until.pop(at, now)
        if silent_until > now:
            entry = self._silence(max(silent_until, _last_end(overdue)) - now)
        else:
            answers = [each._asdict() | {"pdu": each.pdu.hex(" ")} for each in overdue]
            entry = {"boot": self._boot, "at": now, "answers": answers}
        self._entries[at] = entry
        self._keep(at, entry if overdue or silent_until > now else None)

    def close(self) -> None:
        """Returns when the file has been written."""
        if self._file is not None:
            self._file.close()

    def _silence(self, seconds: float) -> Entry:
        return {"boot": self._boot, "silence": seconds}

    def _keep(self, at: str, entry: Entry | None) -> None:
        if self._file is not None:
            self._file.change(at, entry)

    def _aftermath(self, entry: Entry, now: float) -> Aftermath:
        """An entry of before the machine was started is as old as that, or older."""
        is_of_this_boot = entry["boot"] == self._boot
        if "silence" in entry:
            return Aftermath((now if is_of_this_boot else 0.0) + entry["silence"])
        later = min(0.0, now - entry["at"]) if is_of_this_boot else -entry["at"]
        answers = (_overdue(answer, later) for answer in entry["answers"])
        return Aftermath(overdue=tuple(each for each in answers if each.ends_at > now))


def place(port: PortSettings) -> str:
    """The device that a port's name leads to at the moment, or the server: two names of one port have the same."""
    return f"{port.host.lower()}:{port.number}" if isinstance(port, TcpSettings) else os.path.realpath(port.port)


def is_entry(value: Any) -> bool:
    """Whether this can be an entry of the file."""
    try:
        if "silence" in value:
            return isinstance(value["boot"], str) and value["silence"] >= 0
        answers = [_overdue(answer, 0.0) for answer in value["answers"]]
        sound = all(each.asked.function and each.unit >= 0 and each.owed > 0 for each in answers)
        return isinstance(value["boot"], str) and value["at"] >= 0 and sound
    except (LookupError, TypeError, ValueError, RequestError):
        return False


def _last_end(answers: Sequence[Overdue]) -> float:
    return max((each.ends_at for each in answers), default=0.0)


def _overdue(answer: Entry, later: float) -> Overdue:
    return Overdue(**answer | {"pdu": bytes.fromhex(answer["pdu"]), "ends_at": answer["ends_at"] + later})


def _boot_id() -> str:
    try:
        return _BOOT_ID.read_text(encoding="ascii").strip()
    except OSError:  # then an entry of before is taken for one of now, and some seconds are waited for nothing
        return ""
