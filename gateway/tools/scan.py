"""A scan: reads from each unit of a line in the line's idle time, and finds the units that answer.

The reads change nothing: one holding register at address 0, and for units that answer some more that tell kinds of
devices apart (`profiles.recognition`, `signs`). An exception is an answer too. The reads belong to no device: silence
is neither counted nor logged, and no client waits for more than one of them (`lines.idle`).

Late answers are noticed while late windows last. A second answer means that two devices have the address. After bytes
that are no answer the read is repeated before the unit is believed to exist.
"""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Sequence
from contextlib import aclosing, asynccontextmanager
from dataclasses import replace
from typing import Final

from gateway.devices.device import ScannedUnit
from gateway.errors import (
    BrokenResponse,
    LineDown,
    LineLost,
    PortError,
    RequestError,
    ResponseTimeout,
    Unwanted,
    WrongQuestion,
)
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT
from gateway.modbus.pdu import parse_request
from gateway.operator.operations.answers.scan import Found, Progress, SunSpecModel
from gateway.operator.values.requests import AwaitedOrigin
from gateway.profiles.recognition import KnownKind, Recognised, recognise
from gateway.request import Request
from gateway.runtime.gateway_line import GatewayLine
from gateway.timing.budget import AnswerTime
from gateway.timing.table import TimingTable
from gateway.tools.signs import FIRST_QUESTION, OTHERS, QUESTION_AT_ZERO, SIGNS

#: The default limit of an answer, in seconds; later ones are late.
USUAL_LIMIT: Final = 0.3
#: How long a read may wait for idle time, in seconds. A busy line has some every few seconds.
PATIENCE: Final = 60.0
#: The usual rates, the most usual ones first.
RATES: Final = (9600, 19200, 38400, 115200, 57600, 4800, 2400, 1200, 14400)
#: Seconds between progress reports, at least.
PACE: Final = 0.25
#: How often a unit is read whose answers are garbled.
TRIES: Final = 3

#: The progress of a scan, and at the end all units found.
Steps = AsyncGenerator[Progress | tuple[Found, ...], None]


def _first_question(unit: ScannedUnit) -> bytes:
    return QUESTION_AT_ZERO if unit.unit == BROADCAST_UNIT else FIRST_QUESTION


class Scan:
    """Reads `units` of a line, and recognises `kinds`. An answer later than `limit` seconds is late.

    Also while it runs it raises WrongQuestion: the line is down, or has no idle time.
    """

    def __init__(
        self, line: GatewayLine, units: Sequence[int], limit: float = USUAL_LIMIT, kinds: Sequence[KnownKind] = ()
    ) -> None:
        loop = asyncio.get_running_loop()
        mode = line.plan.line.timing.mode
        self._kinds = [kind for kind in kinds if kind.mode in (None, mode)]
        self._line = line
        self._baud = line.driver.line.settings.timing.baud
        self._now = loop.time
        self._of = len(units)
        self._answer_time = AnswerTime(TimingTable(), margin=1.0, timeout=limit)
        self._units = [ScannedUnit(unit, self._answer_time, loop.time) for unit in units]
        #: How often each unit was garbled.
        self._garbled: dict[ScannedUnit, int] = {}
        self._windows_end = 0.0
        self._sent_by_others = line.sent

    async def run(self) -> Steps:
        """Yield the progress, and at the end the units found."""
        started = told = self._now()
        for asked, unit in enumerate(self._units, 1):
            await self._ask_first(unit)
            if self._now() - told >= PACE or asked == self._of:
                told = self._now()
                left = (told - started) / asked * (self._of - asked) + max(0.0, self._windows_end - told)
                yield self._progress(asked, left)
        await self._late_windows_over()
        for _ in range(1, TRIES):
            for unit in list(self._garbled):
                await self._ask_first(unit)
                yield self._progress(self._of)
            await self._late_windows_over()
        found = []
        for unit in self._there():
            found.append(await self._describe(unit))
            yield self._progress(self._of)
        yield tuple(found)

    async def _late_windows_over(self) -> None:
        """Wait until no late answer can come any more."""
        await asyncio.sleep(self._windows_end - self._now())

    def _progress(self, asked: int, left: float = 0.0) -> Progress:
        return Progress(asked, self._of, round(left, 1), tuple(each.unit for each in self._there()), self._baud)

    def _there(self) -> list[ScannedUnit]:
        """Return the units that were heard."""
        return [unit for unit in self._units if unit.heard or self._garbled.get(unit, 0) > 1]

    async def _ask_first(self, unit: ScannedUnit) -> None:
        """Read once from a unit. On a line in use, pause as long as that took, for the other clients."""
        started, others = self._now(), self._line.sent
        unit.heard.clear()
        error = await self._ask(unit, _first_question(unit), awaits_second=True)
        if isinstance(error, BrokenResponse):
            self._garbled[unit] = self._garbled.get(unit, 0) + 1
        if others != self._sent_by_others:
            self._sent_by_others = others
            await asyncio.sleep(self._now() - started)

    async def _describe(self, unit: ScannedUnit) -> Found:
        """Describe a unit that was heard."""
        if self._garbled.get(unit, 0) > 1 or len(unit.heard) > 1 or not unit.heard:
            return Found(unit.unit, "garbled", baud=self._baud)
        frame, elapsed = unit.heard[0]
        code = frame.pdu[1] if frame.pdu[0] & EXCEPTION_BIT else None
        names, models = Recognised()
        if frame.unit != BROADCAST_UNIT:
            names, models = await self._recognise(frame.unit, {_first_question(unit): frame.pdu})
        return Found(
            unit.unit,
            "answers" if code is None else "exception",
            code,
            round(max(0.0, elapsed) * 1000, 1),
            ", ".join(names),
            frame.unit if frame.unit != unit.unit else None,
            self._baud,
            tuple(SunSpecModel(model.model, model.address) for model in models),
        )

    async def _recognise(self, unit: int, answers: dict[bytes, bytes | None]) -> Recognised:
        """Recognise a unit by what tells its kind, or by its signs. `answers` holds known answers by read."""
        steps = recognise(self._kinds)
        try:
            question = next(steps)
            while True:
                question = steps.send(await self._answer_once(unit, question, answers))
        except StopIteration as end:
            found: Recognised = end.value
        return found if found.names else found._replace(names=(await self._profile_of(unit, answers),))

    async def _profile_of(self, unit: int, answers: dict[bytes, bytes | None]) -> str:
        """Return the first profile whose signs all fit."""
        for profile, signs in SIGNS[self._line.plan.line.timing.mode].items():
            for sign in signs:
                pdu = await self._answer_once(unit, sign.question, answers)
                if pdu is None or not sign.fits(pdu, unit):
                    break
            else:
                return profile
        return OTHERS

    async def _answer_once(self, unit: int, pdu: bytes, answers: dict[bytes, bytes | None]) -> bytes | None:
        """Return what the unit answers, and answered before; None for silence."""
        if pdu not in answers:
            answers[pdu] = await self._answer(unit, pdu)
        return answers[pdu]

    async def _answer(self, unit: int, pdu: bytes) -> bytes | None:
        """Return what the unit answers in time, if anything; a late answer to an earlier question is none."""
        asked = ScannedUnit(unit, self._answer_time, self._now)
        await self._ask(asked, pdu)
        return asked.heard[0][0].pdu if asked.heard else None

    async def _ask(self, unit: ScannedUnit, pdu: bytes, *, awaits_second: bool = False) -> RequestError | None:
        """Send a read when the line is idle. What comes is in `unit.heard`; return the error if no good answer came.

        Raises:
            WrongQuestion: the line is down, has no idle time, or another scan of it has begun.
        """
        origin = AwaitedOrigin(lambda: True)
        request = Request(unit.unit, pdu, origin, self._now())
        patience = self._line.patience
        question = ScanTransaction(request, parse_request(pdu), unit, awaits_second=awaits_second, patience=patience)
        self._line.driver.submit(question, self._now())
        try:
            async with asyncio.timeout(PATIENCE):
                error, _ = await origin.outcome
        except TimeoutError:
            raise WrongQuestion(f"{self._line.name} had no idle time for {PATIENCE:g} s") from None
        finally:
            origin.outcome.cancel()
        if isinstance(error, LineDown | LineLost):
            reason = self._line.reconnector.error
            raise WrongQuestion(f"{self._line.name} is down" + (f": {reason}" if reason else ""))
        if isinstance(error, Unwanted):
            raise WrongQuestion(f"another scan of {self._line.name} has begun")
        self._windows_end = max(self._windows_end, self._line.driver.line.ledger.end_of(question, question.fails_at))
        return error if error is None or isinstance(error, ResponseTimeout) else BrokenResponse()


@asynccontextmanager
async def opened(line: GatewayLine) -> AsyncIterator[None]:
    """Keep a line that belongs to no gateway open in this context.

    Raises:
        PortError: its port cannot be opened.
    """
    keeping = asyncio.create_task(line.reconnector.run(), name=f"line:{line.name}")
    try:
        await line.reconnector.tried.wait()
        if line.reconnector.error is not None:
            raise line.reconnector.error
        yield
    finally:
        keeping.cancel()
        await asyncio.gather(keeping, return_exceptions=True)
        line.driver.close()


async def scan_speeds(
    at_rate: Callable[[int], GatewayLine], units: Sequence[int], limit: float, kinds: Sequence[KnownKind]
) -> Steps:
    """Scan at each of RATES that the port can do. `at_rate` makes a line that belongs to no gateway.

    Raises:
        PortError: the port can do none of them.
        WrongQuestion: as a Scan.
    """
    found: tuple[Found, ...] = ()
    troubles: list[PortError] = []
    started, of = asyncio.get_running_loop().time(), len(units) * len(RATES)
    for number, baud in enumerate(RATES):
        line = at_rate(baud)
        try:
            async with opened(line), aclosing(Scan(line, units, limit, kinds).run()) as steps:
                async for step in steps:
                    if isinstance(step, tuple):
                        found += step
                        continue
                    asked = number * len(units) + step.asked
                    spent = asyncio.get_running_loop().time() - started
                    there = (*(each.unit for each in found), *step.found)
                    yield replace(step, asked=asked, of=of, left_s=round(spent / asked * (of - asked), 1), found=there)
        except PortError as error:
            troubles.append(error)
    if len(troubles) == len(RATES):
        raise troubles[0]
    yield found
