"""The config for those who look: what runs, what `check` says of the file as it is now, and how the two differ."""

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass
from difflib import unified_diff
from pathlib import Path
from typing import Final

from gateway.config.masking import masked
from gateway.config.plan import Plan
from gateway.config.problem import Problem
from gateway.errors import ConfigError
from gateway.ports.threads import ThreadPerCall
from gateway.service.config_process import READING_TIME, ConfigRead
from gateway.service.reload import Outcome, Reloader, differences, find_settled
from gateway.service.running import Running

#: So many lines of a comparison are shown, and so many characters of a file.
MOST_LINES: Final = 400
MOST_TEXT: Final = 128 * 1024
#: Files that it names may change too: after so many seconds all is looked at again.
KEPT: Final = 30.0


@dataclass(frozen=True, slots=True)
class ConfigView:
    """`text` is that of the config in use, with masks for secrets, and `difference` what was changed in the file since.

    `changes` are those that a reload would make; `problems` say why it would be rejected, or are warnings. `reloaded`
    is the outcome of the last reload `at` this time of the day, if there was one. A gateway that `is_service` was
    started by systemd.
    """

    file: str
    text: str
    problems: tuple[Problem, ...]
    has_errors: bool
    difference: tuple[str, ...]
    changes: Outcome
    reloaded: Outcome | None
    at: float
    is_service: bool


@dataclass(frozen=True, slots=True)
class _Seen:
    """The file as it was looked at: `sign` changes when it does."""

    sign: tuple[int, ...]
    at: float
    loaded: ConfigRead


class ConfigViewer:
    """Looks at the file again when it has changed, or after a while: checking a long one takes tenths of a second."""

    def __init__(self, running: Running, reloader: Reloader, clock: Callable[[], float] = time.time) -> None:
        self._running = running
        self._reloader = reloader
        self._clock = clock
        self._seen: _Seen | None = None
        self._one_at_a_time = asyncio.Lock()

    async def view(self) -> ConfigView:
        """The config as it is now."""
        loop = asyncio.get_running_loop()
        async with self._one_at_a_time:
            try:
                async with asyncio.timeout(READING_TIME):
                    self._seen = await loop.run_in_executor(ThreadPerCall("web config"), self._look)
            except TimeoutError:
                self._seen = _unread(f"cannot be read within {READING_TIME:g} s; is it a file?")
            except ConfigError as error:
                self._seen = _unread(str(error))
            return await loop.run_in_executor(ThreadPerCall("web config"), self._view, self._seen, loop.time())

    def _look(self) -> _Seen:
        file, sign, now = self._reloader.file, _sign(self._reloader.file), time.monotonic()
        if self._seen is not None and sign and self._seen.sign == sign and now - self._seen.at < KEPT:
            return self._seen
        return _Seen(sign, now, self._reloader.read(file, look_around=True))

    def _view(self, seen: _Seen, now: float) -> ConfigView:
        reloader = self._reloader
        shown, current = masked(reloader.text), masked(seen.loaded.text)
        return ConfigView(
            file=str(reloader.file),
            text=shown[:MOST_TEXT],
            problems=seen.loaded.problems,
            has_errors=seen.loaded.plan is None,
            difference=_difference(shown, current) if reloader.text and seen.loaded.text else (),
            changes=Outcome() if seen.loaded.plan is None else self._changes(seen.loaded.plan),
            reloaded=None if reloader.last is None else reloader.last.outcome,
            at=0.0 if reloader.last is None else self._clock() - now + reloader.last.at,
            is_service=reloader.is_service,
        )

    def _changes(self, plan: Plan) -> Outcome:
        found = differences(self._running.gateway.plan, plan)
        return Outcome(
            added=found.added,
            removed=found.removed,
            changed=found.changed,
            restart=find_settled(self._reloader.at_start, plan),
        )


def _unread(why: str) -> _Seen:
    return _Seen((), 0.0, ConfigRead(None, (Problem("error", (), why),)))


def _sign(file: Path) -> tuple[int, ...]:
    try:
        status = file.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode, status.st_uid


def _difference(old: str, new: str) -> tuple[str, ...]:
    lines = list(unified_diff(old.splitlines(), new.splitlines(), "in use", "in the file", n=2, lineterm=""))
    return (*lines[:MOST_LINES], *(["..."] if len(lines) > MOST_LINES else []))
