"""The config for display: what is in use, what `check` says about the file as it is now, and how the two differ."""

import asyncio
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from gateway.clock.threads import ThreadPerCall
from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem
from gateway.config.reading.masking import difference, shown
from gateway.config.reading.whole_text import parted
from gateway.errors import ConfigError
from gateway.readconfig.process import READING_TIME, ConfigRead
from gateway.runtime.outcome import Outcome
from gateway.runtime.reload import Reloader, changed
from gateway.runtime.running import Running

#: This many characters of a file are shown.
MOST_TEXT: Final = 128 * 1024
#: The file is read again after this many seconds, even if it has not changed: files that it names may have.
KEPT: Final = 30.0
#: The reason why a file cannot be read is kept for this many seconds: finding it may have taken READING_TIME.
UNREAD_KEPT: Final = 10.0


@dataclass(frozen=True, slots=True)
class ConfigView:
    """`text` is the config in use, with secrets masked, and `difference` what was changed in the file since.

    Comments are in neither, and a file that is not TOML is not compared.

    `changes` are those that a reload would make; `problems` say why it would be rejected, or are warnings. `reloaded`
    is the outcome of the last reload, if any, and `at` its time, in seconds since 1970. `is_service`: systemd has
    started the gateway. `fixed` says why it cannot be reloaded, if it comes from a program.
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
    fixed: str = ""


@dataclass(frozen=True, slots=True)
class _Seen:
    """The file as last read. `sign` changes when the file does; it is good `until` this time of the loop's clock."""

    sign: tuple[int, ...]
    until: float
    loaded: ConfigRead


class ConfigViewer:
    """Reads the file again when it has changed, or after KEPT seconds: checking a long one takes tenths of a second."""

    def __init__(self, running: Running, reloader: Reloader, clock: Callable[[], float] = time.time) -> None:
        self._running = running
        self._reloader = reloader
        self._clock = clock
        self._seen: _Seen | None = None

    async def view(self) -> ConfigView:
        """Return the config as it is now. Only one call at a time is allowed."""
        loop = asyncio.get_running_loop()
        self._seen = await self._look(loop)
        return await loop.run_in_executor(ThreadPerCall("web config"), self._view, self._seen, loop.time())

    async def _look(self, loop: asyncio.AbstractEventLoop) -> _Seen:
        sign: tuple[int, ...] = ()
        now = loop.time()
        try:
            async with asyncio.timeout(READING_TIME):
                sign = await loop.run_in_executor(ThreadPerCall("web config"), self._sign)
                if self._seen is not None and sign and self._seen.sign == sign and now < self._seen.until:
                    return self._seen
                read = partial(self._reloader.read, self._reloader.file, look_around=True)
                return _Seen(sign, now + KEPT, await loop.run_in_executor(ThreadPerCall("web config"), read))
        except TimeoutError:
            why = f"cannot be read within {READING_TIME:g} s; is its disk there?"
        except ConfigError as error:
            why = str(error)
        return _Seen(sign, loop.time() + UNREAD_KEPT, ConfigRead(None, (Problem("error", (), why),)))

    def _sign(self) -> tuple[int, ...]:
        """Make a sign of the file, and of those that it had included when it was last read."""
        file = self._reloader.file
        _, included = parted(self._seen.loaded.text if self._seen is not None else "")
        return tuple(part for each in (file, *(file.parent / name for name in included)) for part in _sign(each))

    def _view(self, seen: _Seen, now: float) -> ConfigView:
        reloader = self._reloader
        in_use, current = shown(reloader.text), shown(seen.loaded.text)
        return ConfigView(
            file=reloader.place if reloader.fixed else str(reloader.file),
            fixed=reloader.fixed,
            text=in_use[:MOST_TEXT],
            problems=seen.loaded.problems,
            has_errors=seen.loaded.plan is None,
            difference=difference(in_use, current, "in use", "in the file"),
            changes=Outcome() if seen.loaded.plan is None else self._changes(seen.loaded.plan),
            reloaded=None if reloader.last is None else reloader.last.outcome,
            at=0.0 if reloader.last is None else self._clock() - now + reloader.last.at,
            is_service=reloader.is_service,
        )

    def _changes(self, plan: Plan) -> Outcome:
        return changed(self._running.gateway.plan, plan, self._reloader.at_start)


def _sign(file: Path) -> Iterator[int]:
    try:
        status = file.stat()
    except OSError:
        return
    yield from (status.st_mtime_ns, status.st_size, status.st_ino, status.st_mode, status.st_uid)
