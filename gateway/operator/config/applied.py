"""The last configs that were in use, and how they differ: to find the last good one, and take it back."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from gateway.config.reading.masking import difference, shown
from gateway.config.reading.whole_text import joined, parted
from gateway.operator.config.commands import commands_to_apply, commands_to_include
from gateway.operator.config.view import MOST_TEXT
from gateway.runtime.reload import Reloader
from gateway.state.applied_configs import AppliedConfig


@dataclass(frozen=True, slots=True)
class AppliedRow:
    """A config that was in use from the time `at` on, by the `name` under which it is kept.

    It has as many `more` and `fewer` lines than the one before it, comments left out. `is_in_use`: it is now.
    """

    name: str
    at: datetime
    more: int
    fewer: int
    is_in_use: bool


@dataclass(frozen=True, slots=True)
class AppliedView:
    """One of them: its `text` without comments and secrets, and how it differs from the one before and the one in use.

    `profiles` are the own profiles that it used, which are kept beside its `file`. `commands` take it back.
    """

    at: datetime
    file: str
    text: str
    to_the_one_before: tuple[str, ...]
    to_the_one_in_use: tuple[str, ...]
    is_first: bool
    is_in_use: bool
    profiles: tuple[str, ...]
    commands: tuple[str, ...]


class AppliedViewer:
    """Shows the configs that a `reloader` keeps. All calls block."""

    def __init__(self, reloader: Reloader) -> None:
        self._reloader = reloader
        #: What was listed last, and of what: what is kept does not change.
        self._listed: tuple[tuple[object, ...], list[AppliedRow]] = ((), [])

    def rows(self) -> Sequence[AppliedRow]:
        """List them, the newest first."""
        kept, reloader = self._reloader.applied, self._reloader
        names = [] if kept is None else kept.names()
        key = (*names, reloader.text, reloader.profile_texts)
        if self._listed[0] != key:
            found = [each for each in map(kept.read, names) if each is not None] if kept is not None else []
            self._listed = key, list(self._rows(found))
        return self._listed[1]

    def _rows(self, found: Sequence[AppliedConfig]) -> Iterator[AppliedRow]:
        """List what was `found`; only the newest one can be in use."""
        for place, one in enumerate(found):
            before = found[place + 1] if place + 1 < len(found) else None
            more, fewer = (0, 0) if before is None else _count(before, one)
            yield AppliedRow(one.name, one.at, more, fewer, place == 0 and self._is_in_use(one))

    def view(self, name: str) -> AppliedView | None:
        """Show one; None if there is none of this name."""
        kept, reloader = self._reloader.applied, self._reloader
        one = None if kept is None else kept.read(name)
        if kept is None or one is None:
            return None
        older = next((each for each in kept.names() if each < name), None)
        before = None if older is None else kept.read(older)
        in_use, included = parted(reloader.text)
        text = _shown(one.text, one.included)
        changed = {path: one.included_file(path) for path, each in one.included.items() if included.get(path) != each}
        return AppliedView(
            at=one.at,
            file=str(one.file),
            text=text[:MOST_TEXT],
            to_the_one_before=()
            if before is None
            else difference(_shown(before.text, before.included), text, "before", "this one"),
            to_the_one_in_use=difference(text, _shown(in_use, included), "this one", "in use"),
            is_first=before is None,
            is_in_use=self._is_in_use(one),
            profiles=tuple(one.profiles),
            commands=(
                *commands_to_include(reloader, changed, included.keys() - one.included.keys()),
                *commands_to_apply(reloader, one.file),
            ),
        )

    def _is_in_use(self, one: AppliedConfig) -> bool:
        in_use = (*parted(self._reloader.text), self._reloader.profile_texts)
        return (one.text, one.included, one.profiles) == in_use


def _shown(own: str, included: Mapping[str, str]) -> str:
    return shown(joined(own, dict(sorted(included.items()))))


def _count(before: AppliedConfig, one: AppliedConfig) -> tuple[int, int]:
    """Count the lines that one has more, and fewer, than the one before it."""
    lines = difference(_shown(before.text, before.included), _shown(one.text, one.included), "", "")[2:]
    return sum(line.startswith("+") for line in lines), sum(line.startswith("-") for line in lines)
