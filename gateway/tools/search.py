"""The search for a device that does not answer: at other addresses, then at other rates and formats.

It runs only on an operator's order. Addresses are read on the line between the requests of its clients. Rates and
formats are tried only if no unit answers: the port is taken from the line for some seconds, in which clients get 0A.
"""

import asyncio
from collections.abc import Iterator
from contextlib import aclosing, suppress
from dataclasses import replace
from itertools import chain
from typing import Final, NamedTuple

from gateway.devices.device import Device, DeviceSettings
from gateway.diagnosis.evidence import Search
from gateway.errors import PortError, WrongQuestion
from gateway.lines.driver import LineDriver
from gateway.lines.line import Line
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT
from gateway.operator.operations.operation import IsThere
from gateway.ports.port import SerialSettings
from gateway.ports.reconnector import OPENING_DEADLINE
from gateway.profiles.profile import Profile
from gateway.runtime.gateway_line import GatewayLine
from gateway.runtime.running import Running
from gateway.timing.budget import AnswerTime
from gateway.timing.characters import CharacterFormat
from gateway.timing.table import TimingTable
from gateway.tools.questions import harmless_read, outcome_of
from gateway.tools.scan import RATES, Scan, opened

#: The limit of an answer, in seconds.
PATIENCE: Final = 0.25
#: The most addresses that are read, and the most units per rate and format.
MOST_ADDRESSES: Final = 16
MOST_UNITS: Final = 2
#: The longest that a search at other rates and formats may take, in seconds.
LONGEST_SEARCH: Final = 30.0

#: The usual formats by the mode of the line.
FORMATS: Final = {
    "rtu": (CharacterFormat(8, "E", 1), CharacterFormat(8, "N", 1), CharacterFormat(8, "O", 1)),
    "ascii": (CharacterFormat(7, "E", 1), CharacterFormat(7, "O", 1), CharacterFormat(8, "N", 1)),
}
#: Usual factory settings.
_USUAL_ADDRESSES: Final = (*range(1, 11), LAST_UNIT)


class Speed(NamedTuple):
    """Rate and format of characters."""

    baud: int
    format: CharacterFormat


async def search(
    running: Running, line: GatewayLine, silent: list[Device], *, is_dead: bool, asked_by: IsThere
) -> Search:
    """Search for the `silent` devices. `is_dead`: no unit of the line responds, so other rates may be tried."""

    def is_wanted() -> bool:
        return asked_by() and running.ports.keeps(line)

    addresses = candidates(line, silent)
    found = await _answering(line, addresses, is_wanted)
    result = Search(tuple(addresses), tuple(found))
    if found or not is_dead or not isinstance(line.plan.port, SerialSettings) or line.standby is not None:
        return result
    if running.ports.is_lent(line):
        return result
    async with running.ports.lent(line, "doctor, which tries other rates and formats") as borrowers:
        result = await _search_speeds(line, silent[:MOST_UNITS], result, is_wanted, borrowers)
    with suppress(TimeoutError):
        async with asyncio.timeout(OPENING_DEADLINE):
            await line.reconnector.tried.wait()
    return result


def candidates(line: GatewayLine, silent: list[Device]) -> list[int]:
    """Return likely addresses of silent devices that are not configured: clients' numbers, neighbours, usual ones."""
    wanted = chain(
        (device.settings.known_as for device in silent),
        *((device.unit + 1, device.unit - 1) for device in silent),
        _USUAL_ADDRESSES,
    )
    taken = {device.unit for device in line.devices.values()}
    free = [unit for unit in dict.fromkeys(wanted) if unit not in taken and FIRST_UNIT <= unit <= LAST_UNIT]
    return free[:MOST_ADDRESSES]


def speeds(line: GatewayLine) -> Iterator[Speed]:
    """Yield rates and formats other than those of the line, the most likely first."""
    timing = line.driver.line.settings.timing
    formats = dict.fromkeys((timing.format, *FORMATS[timing.mode]))
    for baud in dict.fromkeys((timing.baud, *RATES)):
        for format_ in formats:
            if (baud, format_) != (timing.baud, timing.format):
                yield Speed(baud, format_)


async def _answering(line: GatewayLine, addresses: list[int], is_wanted: IsThere) -> list[int]:
    """Scan for the addresses at which a unit responds: nothing is logged or counted, and clients go first."""
    with suppress(WrongQuestion):  # the line is down or never idle: then nothing is known
        async with aclosing(Scan(line, addresses, PATIENCE).run()) as steps:
            async for step in steps:
                if not is_wanted():
                    break
                if isinstance(step, tuple):
                    return [each.unit for each in step]
    return []


async def _search_speeds(
    line: GatewayLine, units: list[Device], result: Search, asked_by: IsThere, borrowers: list[Line]
) -> Search:
    tried = 0
    is_virtual = False
    own = line.driver.line.settings.timing
    try:
        async with asyncio.timeout(LONGEST_SEARCH):
            for speed in speeds(line):
                if not asked_by() or (is_virtual and (speed.baud == own.baud or speed.format != own.format)):
                    continue
                try:
                    there = line.at_speed(*speed)
                    borrowers.append(there.driver.line)
                    answers, is_virtual = await _answer_there(there, units, asked_by)
                except PortError:  # the port cannot do this rate or format
                    continue
                tried += 1
                if answers:
                    return replace(result, speeds=tried, speed=(speed.baud, str(speed.format)))
    except TimeoutError:
        pass
    return replace(result, speeds=tried, has_parity=not is_virtual)


async def _answer_there(line: GatewayLine, units: list[Device], asked_by: IsThere) -> tuple[bool, bool]:
    """Tell whether a unit answers on a line at another speed, and whether its port is virtual, without parity.

    Raises:
        PortError: the port cannot be opened like this.
    """
    async with opened(line):
        is_virtual = line.driver.is_virtual
        for unit in units:
            if await _answers(line.driver, unit.unit, asked_by, unit.settings.profile):
                return True, is_virtual
        return False, is_virtual


async def _answers(driver: LineDriver, address: int, asked_by: IsThere, profile: Profile | None = None) -> bool:
    """Tell whether a unit responds at an address; an exception is a response too."""
    patience = AnswerTime(TimingTable(), margin=1.0, timeout=PATIENCE, fixed=True)
    settings = DeviceSettings(f"address {address}", address, address, Profile("generic"), patience, source="doctor")
    pdu = harmless_read(profile or settings.profile)
    if pdu is None or not asked_by():
        return False
    error, _ = await outcome_of(Device(settings, driver), address, pdu, asked_by)
    return error is None
