"""A scan: reads from each unit of a line in the line's idle time, and finds the units that answer.

The reads change nothing: one holding register at address 0, and for units that answer a few more that tell kinds of
devices apart. An exception is an answer too. The reads belong to no device: silence is neither counted nor logged, and
no client waits for more than one of them (`lines.idle`).

Late answers are noticed while late windows last. A second answer means that two devices have the address. After bytes
that are no answer the read is repeated before the unit is believed to exist.
"""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Mapping, Sequence
from contextlib import aclosing, asynccontextmanager
from dataclasses import dataclass, replace
from struct import unpack
from typing import Final

from gateway.devices.device import ScannedUnit
from gateway.errors import (
    BrokenResponse,
    ExceptionCode,
    LineDown,
    LineLost,
    PortError,
    RequestError,
    ResponseTimeout,
    Unwanted,
    WrongQuestion,
)
from gateway.lines.transaction import ScanTransaction
from gateway.modbus.codes import BROADCAST_UNIT, EXCEPTION_BIT, FunctionCode
from gateway.modbus.pdu import parse_request
from gateway.operator.answers.scan import Found, Progress
from gateway.operator.requests import AwaitedOrigin
from gateway.request import Request
from gateway.runtime.gateway_line import GatewayLine
from gateway.timing.budget import AnswerTime
from gateway.timing.characters import Mode
from gateway.timing.table import TimingTable

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


def _question(function: int, address: int, count: int = 1) -> bytes:
    return bytes((function, *address.to_bytes(2, "big"), *count.to_bytes(2, "big")))


#: The first read of each unit. At address 0 a weigher answers a read of its own address.
FIRST_QUESTION: Final = _question(FunctionCode.READ_HOLDING_REGISTERS, 0)
QUESTION_AT_ZERO: Final = _question(FunctionCode.READ_HOLDING_REGISTERS, 0x10)


#: The progress of a scan, and at the end all units found.
Steps = AsyncGenerator[Progress | tuple[Found, ...], None]


@dataclass(frozen=True, slots=True)
class Sign:
    """A read, and a test of whether an answer is typical of a kind of device."""

    question: bytes
    fits: Callable[[bytes, int], bool]


def _refuses(code: int) -> Callable[[bytes, int], bool]:
    return lambda pdu, _unit: pdu[0] & EXCEPTION_BIT > 0 and pdu[1] == code


def _answers(pdu: bytes, _unit: int) -> bool:
    return not pdu[0] & EXCEPTION_BIT


def _is_own_address(pdu: bytes, unit: int) -> bool:
    return _answers(pdu, unit) and pdu[-1] == unit


def _is_rate(pdu: bytes, unit: int) -> bool:
    return _answers(pdu, unit) and unpack(">f", pdu[2:6])[0] in (9600, 14400, 19200)


_COILS: Final = FunctionCode.READ_COILS
_HOLDING: Final = FunctionCode.READ_HOLDING_REGISTERS
_INPUT: Final = FunctionCode.READ_INPUT_REGISTERS

_V80: Final = (
    Sign(_question(_COILS, 0, 1024), _answers),
    Sign(_question(_COILS, 0, 1025), _refuses(ExceptionCode.ILLEGAL_DATA_VALUE)),
)
#: The signs of each kind, from the documents named in profiles/*.toml, as far as reads can tell.
SIGNS: Final[Mapping[Mode, Mapping[str, Sequence[Sign]]]] = {
    "rtu": {
        "weigher": [Sign(QUESTION_AT_ZERO, _is_own_address), Sign(_question(_HOLDING, 0x20, 2), _is_rate)],
        "v80": _V80,
    },
    "ascii": {
        "mint": [
            Sign(FIRST_QUESTION, _refuses(ExceptionCode.ILLEGAL_DATA_ADDRESS)),
            Sign(_question(_HOLDING, 1), _answers),
            Sign(_question(_INPUT, 1), _refuses(ExceptionCode.ILLEGAL_FUNCTION)),
        ],
        "v80": _V80,
    },
}
#: The profile of all other devices.
OTHERS: Final = "generic"


def _first_question(unit: ScannedUnit) -> bytes:
    return QUESTION_AT_ZERO if unit.unit == BROADCAST_UNIT else FIRST_QUESTION


class Scan:
    """Reads `units` of a line. An answer later than `limit` seconds is late.

    Also while it runs it raises WrongQuestion: the line is down, or has no idle time.
    """

    def __init__(self, line: GatewayLine, units: Sequence[int], limit: float = USUAL_LIMIT) -> None:
        loop = asyncio.get_running_loop()
        self._line = line
        self._baud = line.driver.line.settings.timing.baud
        self._now = loop.time
        self._of = len(units)
        answer_time = AnswerTime(TimingTable(), margin=1.0, timeout=limit)
        self._units = [ScannedUnit(unit, answer_time, loop.time) for unit in units]
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
        there = ScannedUnit(frame.unit, unit.answer_time, self._now)
        answers: dict[bytes, bytes | None] = {_first_question(unit): frame.pdu}
        return Found(
            unit.unit,
            "answers" if code is None else "exception",
            code,
            round(elapsed * 1000, 1),
            await self._profile_of(there, answers) if there.unit != BROADCAST_UNIT else "",
            frame.unit if frame.unit != unit.unit else None,
            self._baud,
        )

    async def _profile_of(self, unit: ScannedUnit, answers: dict[bytes, bytes | None]) -> str:
        """Return the first profile whose signs all fit. `answers` holds known answers by read."""
        for profile, signs in SIGNS[self._line.plan.line.timing.mode].items():
            for sign in signs:
                if sign.question not in answers:
                    answers[sign.question] = await self._answer(unit, sign.question)
                pdu = answers[sign.question]
                if pdu is None or not sign.fits(pdu, unit.unit):
                    break
            else:
                return profile
        return OTHERS

    async def _answer(self, unit: ScannedUnit, pdu: bytes) -> bytes | None:
        """Return what the unit answers in time, if anything."""
        unit.heard.clear()
        await self._ask(unit, pdu)
        return unit.heard[0][0].pdu if unit.heard else None

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


async def scan_speeds(at_rate: Callable[[int], GatewayLine], units: Sequence[int], limit: float) -> Steps:
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
            async with opened(line), aclosing(Scan(line, units, limit).run()) as steps:
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
