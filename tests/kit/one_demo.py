"""Files of tests that look at pages of the demo. Each set of them has one browser and one demo, and so one worker."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import Any

_SETS = (
    {"test_pages_in_browser", "test_overview_page", "test_events_page", "test_trend_page"},
    {"test_traffic_page", "test_strip", "test_values_page", "test_head_and_tables"},
)


def set_of(file: Path) -> frozenset[str]:
    """Return the names of the files that share with this one; its own path if it shares with none."""
    return frozenset(next((each for each in _SETS if file.stem in each), {str(file)}))


class Shared:
    """What is made once for all files of a set. It ends before the next set: a demo takes a tenth of a core."""

    def __init__(self) -> None:
        self._set: frozenset[str] = frozenset()
        self._made: dict[Callable[..., Any], Any] = {}
        self._ends = ExitStack()

    def get(self, make: Callable[[], AbstractContextManager[Any]]) -> Any:
        """Return what `make` has made, or makes now."""
        if make not in self._made:
            self._made[make] = self._ends.enter_context(make())
        return self._made[make]

    def begin(self, files: frozenset[str]) -> None:
        """End what is there unless it is for these files."""
        if files != self._set:
            self._made.clear()
            self._ends.close()
            self._set = files
