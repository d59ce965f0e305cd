"""Late responses that may arrive after a line was removed or the process restarted: they belong to the port.

    {"/dev/ttyS1": {"at": 812.4, "answers": [
        {"unit": 1, "answers_from": 1, "pdu": "03 00 07 00 01", "owed": 1, "ends_at": 814.1}
    ]}}

A line on this port stopped 812.4 s after the machine was started, and responses to this request can arrive until
814.1 s. If `owed` is 0, another client has sent it, and may be there until then. If the machine was restarted, its
clock is behind that: the rest of the time then counts from the restart, which is as long or longer. If the new clock is
already past 812.4 s, the restart goes unnoticed, and less of the time is left.
"""

import os
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from gateway.errors import RequestError
from gateway.lines.exchange import Exchange
from gateway.modbus.pdu import parse_sent
from gateway.ports.port import PortSettings, PtySettings, SiteSettings, TcpSettings
from gateway.state.entry_file import Entries, EntryFile

FILE_NAME: Final = "late.json"

#: The longest late window, in seconds: an entry with a longer one is damaged. A config can ask for a little more than
#: twice a hundred weeks: `margin` x a time in a table.
LONGEST: Final = 4 * 365 * 86_400.0
UNITS: Final = range(256)

_PSEUDO_TERMINALS: Final = Path("/dev/pts")

Entry = dict[str, Any]
_KEYS: Final = {"unit", "answers_from", "pdu", "owed", "ends_at"}


class LeftBehind:
    """What may still arrive on ports of removed lines, see Ledger.handed_on; with a `file` also for the next process.

    The key of a port is its place, see `place_of`. Times are seconds of the monotonic clock, like those of the event
    loop.
    """

    def __init__(self, file: EntryFile | None = None) -> None:
        self._file = file
        self._entries: Entries = {} if file is None else file.read()

    def at(self, place: str, now: float) -> list[Exchange]:
        """Return what may still arrive at this place."""
        entry = self._entries.get(place)
        if entry is None:
            return []
        return read_entry(entry, now, -entry["at"] if entry["at"] > now else 0.0)

    def leave(self, place: str, answers: Sequence[Exchange], now: float) -> None:
        """Replace what may still arrive where a line has stopped. Expired entries are deleted."""
        for there in list(self._entries):
            if there == place or not self.at(there, now):
                del self._entries[there]
                self._write(there, None)
        if answers:
            self._entries[place] = as_entry(answers, now)
            self._write(place, self._entries[place])

    def close(self) -> None:
        """Close the file, and return when it has been written."""
        if self._file is not None:
            self._file.close()

    def _write(self, place: str, entry: Entry | None) -> None:
        if self._file is not None:
            self._file.change(place, entry)


def as_entry(exchanges: Iterable[Exchange], now: float, later: float = 0.0) -> Entry:
    """Make the entry of the file from what is open `now`; all its times become `later` by this many seconds."""
    return {"at": now + later, "answers": [_as_answer(each, later) for each in exchanges]}


def read_entry(entry: Entry, now: float, later: float) -> list[Exchange]:
    """Read what may still arrive after `now`; all times become `later` by this many seconds."""
    return [each for answer in entry["answers"] if (each := _exchange(answer, later)).ends_at > now]


def place_of(port: PortSettings | SiteSettings) -> str:
    """Find the device that a port's name points to at the moment: two names of one device have the same place.

    For a device server it is the host in lower case, and the port number; for a virtual port its link. For a
    pseudo-terminal it includes the time of its creation: the next one may get its number.
    """
    if isinstance(port, SiteSettings):
        return port.port
    if isinstance(port, PtySettings):
        return port.name
    if isinstance(port, TcpSettings):
        return f"{port.host.lower()}:{port.number}"
    device = Path(os.path.realpath(port.port))
    if device.parent == _PSEUDO_TERMINALS:
        with suppress(OSError):
            return f"{device} of {device.stat().st_ctime_ns}"
    return str(device)


def is_entry(value: Any) -> bool:
    """Return whether this is a well-formed entry of the file."""
    try:
        exchanges = [_exchange(answer, 0.0) for answer in value["answers"]]
        sound = all(map(_is_sound, exchanges))
        longest = max((each.ends_at for each in exchanges), default=0.0) - value["at"]
        return bool(value["at"] >= 0) and longest < LONGEST and sound
    except (ArithmeticError, LookupError, TypeError, ValueError, RequestError):
        return False


def _is_sound(exchange: Exchange) -> bool:
    """Return whether a line can expect it: numbers from a file may be anything."""
    units = (exchange.unit,) if exchange.answers_from is None else (exchange.unit, exchange.answers_from)
    are_whole = all(isinstance(number, int) for number in (*units, exchange.owed))
    is_known = bool(exchange.asked.function) and exchange.owed >= 0
    return are_whole and all(unit in UNITS for unit in units) and is_known


def _as_answer(exchange: Exchange, later: float) -> Entry:
    return {
        "unit": exchange.unit,
        "answers_from": exchange.answers_from,
        "pdu": exchange.asked.data.hex(" "),
        "owed": exchange.owed,
        "ends_at": exchange.ends_at + later,
    }


def _exchange(answer: Entry, later: float) -> Exchange:
    if set(answer) != _KEYS:
        raise ValueError(f"{sorted(_KEYS)} are awaited")
    asked = parse_sent(bytes.fromhex(answer["pdu"]))
    exchange = Exchange(answer["unit"], answer["answers_from"], asked, 0)
    exchange.owed = answer["owed"]
    exchange.ends_at = answer["ends_at"] + later
    return exchange
