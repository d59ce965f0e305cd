"""The values of persistent images on the disk. All calls block."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NamedTuple

from gateway.modbus.codes import Area
from gateway.state.page_log import PageLog

_NAME: Final = "images"
#: The file that each write changes.
LOG: Final = f"{_NAME}.log"
#: The most values in a record: with the longest name of an image it fits into a page.
_MOST_IN_A_RECORD: Final = 128

#: Values by image and area, then by address.
Values = dict[tuple[str, Area], dict[int, int]]


def add(to: Values, *more: Values) -> Values:
    """Add values to `to`, and return it; later ones replace earlier ones."""
    for each in more:
        for table, values in each.items():
            to.setdefault(table, {}).update(values)
    return to


class SavedValues:
    """The open files, locked against other processes."""

    def __init__(self, log: PageLog) -> None:
        self._log = log

    def write(self, values: Values, kept: Values) -> None:
        """Write all of the values or none; on return they are on the disk. `kept` are all earlier values.

        Raises:
            OSError: they cannot be written.
            StateError: another process has the files open.
        """
        self._log.write(_records(values, {}), lambda: _records(kept, values))

    def close(self) -> None:
        """Close the files."""
        self._log.close()


class Opened(NamedTuple):
    """Open files and their values. `damage` describes a fault of the files; empty if there was none."""

    saved: SavedValues
    values: Values
    damage: str = ""


def open_saved(folder: Path) -> Opened:
    """Read the values in `folder`. Nothing is written yet.

    Raises:
        StateError: another process has them open, or a later version has written them.
        OSError: they cannot be read.
    """
    log = PageLog(folder / _NAME)
    records, damage = log.open()
    values: Values = {}
    for record in records:
        image, area, start, content = json.loads(record)
        add(values, {(image, Area(area)): dict(enumerate(content, start))})
    return Opened(SavedValues(log), values, damage)


def _records(kept: Values, changed: Values) -> Iterator[bytes]:
    """Encode each run of neighbours as a record: `["shift-data","holding",5,[7,8,9]]` from address 5 on."""
    for image, area in sorted(kept.keys() | changed.keys()):
        values = kept.get((image, area), {}) | changed.get((image, area), {})
        for run in _runs(sorted(values)):
            content = [image, area, run[0], [values[address] for address in run]]
            yield json.dumps(content, ensure_ascii=False, separators=(",", ":")).encode()


def _runs(addresses: Iterable[int]) -> Iterator[list[int]]:
    run: list[int] = []
    for address in addresses:
        if run and (address != run[-1] + 1 or len(run) == _MOST_IN_A_RECORD):
            yield run
            run = []
        run.append(address)
    if run:
        yield run
