"""The report `doctor --hardware-report`: the behaviour of a serial adapter and its driver.

The port is opened by the same code as for a line. Nothing is sent unless a unit is named; then one holding register at
address 0 is read from it. The report has no names of the machine or its users, no addresses and no serial numbers.
"""

import asyncio
import platform
from collections.abc import AsyncIterator, Callable, Iterable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field, replace
from statistics import median
from typing import Final, Literal, NamedTuple

from gateway import request
from gateway.errors import PortError
from gateway.hardware.listing import Adapter, describe_adapter
from gateway.modbus.rtu import SHORTEST, crc_fits, encode
from gateway.ports.port import CharacterErrors, Opener, Port, SerialSettings
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.version import __version__

#: Usual rates, and some that few UARTs can divide exactly.
RATES: Final = (
    *(1200, 2400, 4800, 9600, 14400, 19200, 28800, 38400, 57600, 76800, 100000, 115200),
    *(187500, 230400, 250000, 460800, 500000, 921600),
)
FORMATS: Final = ("8N1", "8E1", "8O1", "8N2", "7N2", "7E1", "7O1")
#: The number of reads that are timed, and the limit of each, in seconds.
READS: Final = 20
LIMIT: Final = 1.0
#: How long to wait for a manual action, and how long to read meanwhile, in seconds.
PATIENCE: Final = 60.0
WATCHING: Final = 20.0
#: Pause between reads, and between attempts to open a port, in seconds.
PAUSE: Final = 0.05
#: FC 03, address 0, one register.
_QUESTION: Final = b"\x03\x00\x00\x00\x01"
_EXCEPTION_SIZE: Final = 5

Outcome = Literal["answered", "damaged", "silent"]


class ReportRow(NamedTuple):
    """One fact."""

    what: str
    seen: str


class Section(NamedTuple):
    """Related facts."""

    title: str
    rows: list[ReportRow]


class Read(NamedTuple):
    """One read: the seconds until the first and the last byte of its answer, and the pieces in which it came."""

    outcome: Outcome
    first: float = 0.0
    whole: float = 0.0
    pieces: int = 0
    has_echo: bool = False


@dataclass
class _Listener:
    """The user of the port: records received bytes and their times."""

    now: Callable[[], float]
    heard: list[tuple[float, bytes]] = field(default_factory=list)
    damaged: bool = False
    error: PortError | None = None
    #: Set when something was received, or the port was lost.
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def received(self, data: bytes, *, damaged: bool = False) -> None:
        self.heard.append((self.now(), data))
        self.damaged = self.damaged or damaged
        self.news.set()

    def lost(self, error: PortError) -> None:
        self.error = error
        self.news.set()

    def forget(self) -> None:
        self.heard.clear()
        self.damaged = False


@asynccontextmanager
async def _held(opener: Opener, settings: SerialSettings) -> AsyncIterator[tuple[Port, _Listener]]:
    """Hold a port open inside the context."""
    listener = _Listener(asyncio.get_running_loop().time)
    port = await opener(settings)(listener)
    try:
        yield port, listener
    finally:
        port.close()
        with suppress(TimeoutError):  # the driver may hang
            async with asyncio.timeout(PATIENCE):
                await port.wait_closed()


async def look_at(opener: Opener, settings: SerialSettings, unit: int | None) -> list[Section]:
    """Examine the port; read `unit`, unless it is None.

    Raises:
        PortError: the port cannot be opened.
    """
    found = describe_adapter(settings.port)
    sections = [Section("Machine", about_machine()), Section("Adapter", about_adapter(found))]
    sections.append(Section("Driver", await _about_driver(opener, settings)))
    sections.append(Section("Rates", [await _tried(opener, replace(settings, baud=baud), f"{baud}") for baud in RATES]))
    formats = [(text, replace(settings, format=CharacterFormat.parse(text))) for text in FORMATS]
    sections.append(Section("Formats", [await _tried(opener, each, text) for text, each in formats]))
    if unit is not None:
        sections.append(Section(f"Unit {unit}", await read_for(opener, settings, unit, count=READS)))
    return sections


def about_machine() -> list[ReportRow]:
    """Name the versions of gateway, Python, kernel and system."""
    system = "unknown"
    with suppress(OSError):
        system = platform.freedesktop_os_release().get("PRETTY_NAME", system)
    return [
        ReportRow("gateway", f"{__version__}, {_how_it_runs()}"),
        ReportRow("Python", platform.python_version()),
        ReportRow("kernel", f"{platform.release()} {platform.machine()}"),
        ReportRow("system", system),
    ]


def _how_it_runs() -> str:
    return "not compiled: takes twice the processor time" if (request.__file__ or "").endswith(".py") else "compiled"


def about_adapter(found: Adapter) -> list[ReportRow]:
    """Describe the adapter as the system knows it."""
    links = ", ".join(found.links)
    rows = [
        ReportRow("device", found.device),
        ReportRow("driver", found.driver or "none that is known"),
        ReportRow("vendor and product", found.ids or "not on USB"),
        *(ReportRow(name, text) for name, text in found.usb.items()),
    ]
    if found.ids:
        rows.append(
            ReportRow("serial number", "yes" if found.has_serial_number else "none: only its socket tells it apart")
        )
    rows.append(ReportRow("stable links", links or "none"))
    if found.latency_timer:
        rows.append(ReportRow("latency timer before", f"{found.latency_timer} ms"))
    return rows


async def _about_driver(opener: Opener, settings: SerialSettings) -> list[ReportRow]:
    async with _held(opener, settings) as (port, listener):
        rows = [
            ReportRow("opens at", _opened_as(port, settings)),
            ReportRow("adds to a response at most", f"{port.latency * 1000:g} ms, as the gateway assumes"),
            ReportRow("counts wrong characters", "no" if port.errors is None else "yes"),
        ]
        timer = describe_adapter(settings.port).latency_timer
        if timer:
            rows.append(ReportRow("latency timer while open", f"{timer} ms"))
        port.change_baud(9600 if settings.baud != 9600 else 19200)
        with suppress(TimeoutError):
            async with asyncio.timeout(LIMIT):
                await listener.news.wait()
        rows.append(
            ReportRow("changes its rate while open", "yes" if listener.error is None else why(listener.error, settings))
        )
    rows.append(await _tried(opener, replace(settings, rs485="kernel"), "RS-485 in the driver"))
    return rows


def why(error: PortError, settings: SerialSettings) -> str:
    """Return the error without the path of the port, which may contain the adapter's serial number."""
    return str(error).replace(settings.port, "the port")


def _opened_as(port: Port, settings: SerialSettings) -> str:
    if port.is_virtual:
        return "any rate and format: a pseudo-terminal, which has none"
    actual = "a rate that its driver does not tell" if port.baud is None else f"{port.baud} baud"
    return f"{actual}, {settings.format}"


async def _tried(opener: Opener, settings: SerialSettings, what: str) -> ReportRow:
    try:
        async with _held(opener, settings) as (port, _):
            differs = port.baud not in (None, settings.baud)
            return ReportRow(what, f"yes, as {port.baud}" if differs else "yes")
    except PortError as error:
        return ReportRow(what, f"no: {why(error, settings)}")


async def read_for(
    opener: Opener, settings: SerialSettings, unit: int, *, count: int | None = None, seconds: float = PATIENCE
) -> list[ReportRow]:
    """Read the unit `count` times, or for this many seconds, and describe the results.

    Raises:
        PortError: the port cannot be opened.
    """
    timing, now = LineTiming("rtu", settings.baud, settings.format), asyncio.get_running_loop().time
    until, reads = now() + seconds, list[Read]()
    async with _held(opener, settings) as (port, listener):
        while now() < until and len(reads) != count and listener.error is None:
            await asyncio.sleep(max(PAUSE, timing.t35))
            reads.append(await _read(port, listener, encode(unit, _QUESTION)))
        rows = told(reads, timing)
        if listener.error is not None:
            rows.append(ReportRow("the port was lost", why(listener.error, settings)))
        return [*rows, *_counted(port.errors)]


async def _read(port: Port, listener: _Listener, request: bytes) -> Read:
    listener.forget()
    began = listener.now()
    port.write(request)
    with suppress(TimeoutError):
        async with asyncio.timeout(LIMIT):
            while not _is_answer(_heard(listener, request)[0], request) and listener.error is None:
                listener.news.clear()
                await listener.news.wait()
    answer, arrivals = _heard(listener, request)
    has_echo = len(arrivals) < len(listener.heard) or _joined(listener.heard).startswith(request)
    if not answer:
        return Read("silent", has_echo=has_echo)
    if listener.damaged or not _is_answer(answer, request):
        return Read("damaged", has_echo=has_echo)
    return Read("answered", arrivals[0] - began, arrivals[-1] - began, len(arrivals), has_echo)


def _heard(listener: _Listener, request: bytes) -> tuple[bytes, list[float]]:
    """Return the bytes received after an echo of the request, if any, and the arrival times of their pieces."""
    heard = _joined(listener.heard)
    echoed = len(request) if heard.startswith(request) else 0
    size, arrivals = 0, []
    for at, data in listener.heard:
        size += len(data)
        if size > echoed:
            arrivals.append(at)
    return heard[echoed:], arrivals


def _joined(heard: Iterable[tuple[float, bytes]]) -> bytes:
    return b"".join(data for _, data in heard)


def _is_answer(data: bytes, request: bytes) -> bool:
    return len(data) >= max(SHORTEST, _EXCEPTION_SIZE) and data[0] == request[0] and crc_fits(data)


def told(reads: Sequence[Read], timing: LineTiming) -> list[ReportRow]:
    """Describe the results of reads."""
    outcomes = [read.outcome for read in reads]
    counts = ", ".join(f"{outcomes.count(each)} {each}" for each in ("answered", "damaged", "silent"))
    rows = [ReportRow("reads", f"{len(reads)}: {counts}")]
    if any(read.has_echo for read in reads):
        rows.append(ReportRow("echo", "yes: the adapter returns what is sent, so its line needs echo = true"))
    elif reads:
        rows.append(ReportRow("echo", "none"))
    answered = [read for read in reads if read.outcome == "answered"]
    if answered:
        on_the_wire = timing.frame(len(_QUESTION)) + timing.frame(4)
        rows += [
            ReportRow("until the first byte", _spread(read.first for read in answered)),
            ReportRow("until the last byte", _spread(read.whole for read in answered)),
            ReportRow(
                "frames on the wire", f"{on_the_wire * 1000:.1f} ms by arithmetic; the rest is device and adapter"
            ),
            ReportRow("pieces of an answer", f"{max(read.pieces for read in answered)} at most"),
        ]
    return rows


def _spread(times: Iterable[float]) -> str:
    ordered = sorted(1000 * each for each in times)
    return f"{ordered[0]:.1f} to {ordered[-1]:.1f} ms, median {median(ordered):.1f} ms"


def _counted(errors: CharacterErrors | None) -> list[ReportRow]:
    if errors is None:
        return [ReportRow("the driver counted", "nothing: it does not count")]
    text = f"{errors.received} characters, {errors.framing} without a stop bit, {errors.parity} of wrong parity"
    return [ReportRow("the driver counted", f"{text}, {errors.overrun} lost")]


async def wait_for_loss(opener: Opener, settings: SerialSettings, ready: Callable[[], None]) -> ReportRow:
    """Hold the port until it is lost, for PATIENCE at most. `ready` is called once it is open.

    Raises:
        PortError: the port cannot be opened.
    """
    async with _held(opener, settings) as (_, listener):
        ready()
        with suppress(TimeoutError):
            async with asyncio.timeout(PATIENCE):
                while listener.error is None:
                    listener.news.clear()
                    await listener.news.wait()
        seen = "not noticed" if listener.error is None else f"noticed: {why(listener.error, settings)}"
        return ReportRow("unplugged", seen)


async def wait_for_return(opener: Opener, settings: SerialSettings) -> ReportRow:
    """Try to open the port until that works, for PATIENCE at most."""
    now, error = asyncio.get_running_loop().time, ""
    until = now() + PATIENCE
    while now() < until:
        try:
            async with _held(opener, settings):
                return ReportRow("plugged in again", f"opened, as {describe_adapter(settings.port).device}")
        except PortError as failed:
            error = why(failed, settings)
        await asyncio.sleep(PAUSE)
    return ReportRow("plugged in again", f"not opened: {error}")
