"""Harmless reads, sent when an operator looks for a fault."""

import asyncio
from collections.abc import Callable
from typing import Final

from gateway.errors import RequestError
from gateway.modbus.codes import Area, FunctionCode
from gateway.operator.values.requests import AwaitedOrigin
from gateway.profiles.profile import Profile
from gateway.request import Request, Target

#: Functions that read and their areas, the most usual first.
_READS: Final = (
    (FunctionCode.READ_HOLDING_REGISTERS, Area.HOLDING),
    (FunctionCode.READ_INPUT_REGISTERS, Area.INPUT),
    (FunctionCode.READ_COILS, Area.COILS),
    (FunctionCode.READ_DISCRETE_INPUTS, Area.DISCRETE),
)


def harmless_read(profile: Profile) -> bytes | None:
    """Return the PDU that reads the first item of such a device; None if it has none."""
    for function, area in _READS:
        ranges = profile.areas.get(area, ((0, 0),))
        if profile.knows(function) and ranges:
            return bytes((function,)) + ranges[0][0].to_bytes(2, "big") + b"\x00\x01"
    return None


async def outcome_of(
    target: Target, unit: int, pdu: bytes, is_there: Callable[[], bool]
) -> tuple[RequestError | None, bytes | None]:
    """Send a request, and return its error, if any, and its response."""
    loop = asyncio.get_running_loop()
    question = AwaitedOrigin(is_there)
    target.submit(Request(unit, pdu, question, loop.time()), loop.time())
    return await question.outcome
