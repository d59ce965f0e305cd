"""Carries out the calls of a unit made in Python: as tasks of an event loop, which may be that of another thread."""

import asyncio
import reprlib
from asyncio import CancelledError
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from contextlib import AbstractAsyncContextManager, nullcontext, suppress
from functools import partial
from operator import index
from struct import pack
from traceback import format_exception, format_exception_only
from typing import Any, Final

from gateway.clock.lazy_timer import LazyTimer
from gateway.errors import DeviceFailure, Refused, RequestError
from gateway.events import CustomUnitFailed, Emit, PartFailed
from gateway.images.custom_calls import Call
from gateway.images.custom_image import CustomImage
from gateway.images.custom_unit import CustomUnit
from gateway.images.image import ImageSettings
from gateway.modbus.pdu import Span
from gateway.registers.items import has_bits
from gateway.trace.ring import Ring

#: Failures of a unit are logged no more often than this, in seconds.
LOGGED_EVERY: Final = 10.0
#: The longest text of an error that is told.
_MOST_TEXT: Final = 300
#: The most characters of a traceback that are logged, its last ones.
_MOST_TRACED: Final = 20_000
#: An exception code has one byte.
MOST_CODE: Final = 255

#: Has a callback called in the event loop of some thread, from any thread, soon and never at once.
CallSoon = Callable[..., object]
Outcome = bytes | RequestError
#: Carries out a call.
Work = Callable[[Call], Coroutine[Any, Any, Outcome]]
#: The turn of a unit that only one image has.
NOBODY_ELSE: Final = nullcontext()


class CustomDriver:
    """Carries out the calls of `unit` in the loop `there`, and tells its `image` in `loop` how they have ended.

    An error in the unit is contained here, and so is one in the image: it is logged, and the request fails.
    """

    def __init__(
        self,
        settings: ImageSettings,
        unit: CustomUnit,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        ring: Ring,
        there: CallSoon | None = None,
        turn: AbstractAsyncContextManager[object] = NOBODY_ELSE,
    ) -> None:
        """Calls are carried out in `loop` itself without `there`, each in its `turn` if others use the unit too."""
        self.unit = unit
        self._emit = emit
        self._turn = turn
        self._time = loop.time
        self._there = there or loop.call_soon
        self._here = partial(_call_in, loop) if there else loop.call_soon
        self._timer = LazyTimer(loop, self._wake)
        self._call: _CarriedOut | None = None
        self._failures = _Failures(settings, emit)
        self.image = CustomImage(settings, self, emit, ring)

    @property
    def is_busy(self) -> bool:
        """Whether a call goes on."""
        return self._call is not None

    def begin(self, call: Call) -> None:
        """See Calls."""
        self._call = carried_out = _CarriedOut(self._work, call, self._here, self._ended)
        try:
            self._there(carried_out.begin)
        except RuntimeError as error:  # no thread can be started
            self._here(self._ended, carried_out, error)

    def cancel(self) -> bool:
        """See Calls."""
        if self._call is None:
            return False
        if self._call.is_withdrawn():
            self._call = None
            return False
        self._call.is_cancelled = True
        self._there(self._call.cancel)
        return True

    def wake_at(self, deadline: float | None) -> None:
        """See Calls."""
        self._timer.set(deadline)

    def close(self) -> None:
        """Fail all requests, and cancel the present call; a unit may not heed that."""
        self._run(self.image.close)

    async def _work(self, call: Call) -> Outcome:
        async with self._turn:
            return await carry_out(self.unit, call)

    def _wake(self) -> None:
        self._run(self.image.tick)

    def _ended(self, carried_out: "_CarriedOut", outcome: Outcome | BaseException) -> None:
        if carried_out is not self._call:
            return
        self._call = None
        if carried_out.is_cancelled and isinstance(outcome, CancelledError):
            outcome = b""
        elif not isinstance(outcome, bytes | RequestError):
            outcome = self._failures.told(outcome, self._time())
        self._run(partial(self.image.ended, outcome))

    def _run(self, step: Callable[[float], None]) -> None:
        try:
            step(self._time())
        except Exception as error:  # noqa: BLE001 - the error boundary of a custom unit: a defect must not reach others
            self._emit(PartFailed.of(f"custom unit {self.image.name}", error))
            self.cancel()
            self._call = None
            self.image.abandon(self._time())


class _Failures:
    """Makes errors of a unit known: each to its client, and to the log one in LOGGED_EVERY seconds."""

    def __init__(self, settings: ImageSettings, emit: Emit) -> None:
        self._unit = settings.unit
        self._name = settings.name
        self._emit = emit
        self._next = 0.0
        self._others = 0

    def told(self, error: BaseException, now: float) -> DeviceFailure:
        """Return the error for the client."""
        text = _text(error)
        if now < self._next:
            self._others += 1
        else:
            traceback = (
                "" if isinstance(error, _WrongValues) else _encodable("".join(format_exception(error))[-_MOST_TRACED:])
            )
            self._emit(CustomUnitFailed(self._unit, self._name, text, traceback, self._others or None))
            self._next, self._others = now + LOGGED_EVERY, 0
        return DeviceFailure(f"{self._name} has failed: {text}")


class _CarriedOut:
    """A call that is carried out in the loop of another thread, or of the same one."""

    def __init__(self, work: Work, call: Call, here: CallSoon, ended: Callable[["_CarriedOut", Any], None]) -> None:
        self._work = work
        self._call = call
        self._here = here
        self._ended = ended
        #: Says to both threads whether it has begun.
        self._state: Future[None] = Future()
        self._task: asyncio.Task[Outcome] | None = None
        self.is_cancelled = False

    def begin(self) -> None:
        """Begin, unless it is withdrawn. Called in the loop where it is carried out."""
        if self._state.set_running_or_notify_cancel():
            self._task = asyncio.get_running_loop().create_task(self._work(self._call), name="custom unit")
            self._task.add_done_callback(self._done)

    def is_withdrawn(self) -> bool:
        """Withdraw it if it has not begun. Return whether that is so."""
        return self._state.cancel()

    def cancel(self) -> None:
        """Cancel it. Called in the loop where it is carried out."""
        if self._task is not None:
            self._task.cancel()

    def _done(self, task: asyncio.Task[Outcome]) -> None:
        error = CancelledError() if task.cancelled() else task.exception()
        self._here(self._ended, self, task.result() if error is None else error)


class _WrongValues(Exception):  # noqa: N818 - what a unit has returned, for its author
    """A unit has returned what cannot be the values."""


async def carry_out(unit: CustomUnit, call: Call) -> Outcome:
    """Carry out a call. Return the items that it has read, two bytes or one each, or the exception for its client.

    Raises:
        Exception: what else the unit raises; or it has returned something else than that many registers or bits.
    """
    try:
        span, values = call
        if values is not None:
            await unit.write(span.area, span.start, list(values))
            return b""
        return _items(span, await unit.read(span.area, span.start, span.count))
    except RequestError as error:
        return _for_clients(error.with_traceback(None))
    except SystemExit as error:  # a task would end its loop with it
        raise RuntimeError(f"SystemExit({error.code!r})") from error


def _for_clients(error: RequestError) -> RequestError:
    """Make of an error that a unit has raised one of ours: its class may have attributes of another meaning.

    Raises:
        RuntimeError: it has no exception code.
    """
    kind, code = type(error), getattr(error, "code", None)  # a class may have none
    if not isinstance(code, int) or not 0 < code <= MOST_CODE:
        raise RuntimeError(f"{kind.__name__} has the code {code}, which is no exception code") from error
    said = str(error)[:_MOST_TEXT]
    said.encode()  # where it is told later, nothing is raised any more
    ours = next(each for each in kind.__mro__ if each.__module__ == RequestError.__module__)
    return ours(said) if getattr(ours, "code", None) == code else Refused(said, code)


def _items(span: Span, values: Any) -> bytes:
    """Encode what a unit has returned for a span.

    Raises:
        _WrongValues: it is something else than so many registers or bits.
    """
    area, count = span.area, span.count
    asked = f"read({area}, {span.start}, {count})"
    try:
        numbers = [index(value) for value in values] if len(values) == count else []
        if len(numbers) != count:
            raise _WrongValues(f"{asked} has returned {len(values)} values, not {count}")
    except TypeError:
        raise _WrongValues(f"{asked} has returned {reprlib.repr(values)}, which is no list of integers") from None
    most = 1 if has_bits(area) else 0xFFFF
    wrong = next((at for at, value in enumerate(numbers) if not 0 <= value <= most), None)
    if wrong is not None:
        place = f"{area} {span.start + wrong}"
        raise _WrongValues(f"{asked} has returned {numbers[wrong]} for {place}: it must be 0 to {most}")
    return bytes(numbers) if has_bits(area) else pack(f">{count}H", *numbers)


def _text(error: BaseException) -> str:
    """Name an error and say what it says, in one line."""
    text = str(error) if isinstance(error, _WrongValues) else "".join(format_exception_only(error))
    return _encodable(" ".join(text.split())[:_MOST_TEXT])


def _encodable(text: str) -> str:
    """Write what no file and no message could have, halves of surrogate pairs, as Python does."""
    return text.encode(errors="backslashreplace").decode()


def _call_in(loop: asyncio.AbstractEventLoop, call: Callable[..., object], *arguments: Any) -> None:
    """Have `loop` call from another thread; once it is closed, nobody waits for that."""
    with suppress(RuntimeError):
        loop.call_soon_threadsafe(call, *arguments)
