"""A unit, as the program asks it that the gateway is a part of."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any, Final, TypeVar

from gateway.config.values.reserved_names import EMBEDDED
from gateway.errors import (
    Busy,
    DeviceFailure,
    IllegalAddress,
    IllegalFunction,
    IllegalValue,
    LineDown,
    NoResponse,
    Refused,
    RequestError,
)
from gateway.library.reading import Reading
from gateway.modbus.codes import EXCEPTION_BIT, Area
from gateway.modbus.pdu import Span
from gateway.operator.operator import Operator
from gateway.operator.requests import AwaitedOrigin
from gateway.registers.items import items_read, read_request
from gateway.request import Caller, Request

T = TypeVar("T")

#: The caller of all requests of the program.
CALLER: Final = Caller.without_address(EMBEDDED)

_BY_CODE: Final[dict[int, Callable[[str], RequestError]]] = {
    error.code: error
    for error in (IllegalFunction, IllegalAddress, IllegalValue, DeviceFailure, Busy, LineDown, NoResponse)
}


class UnitClient:
    """A unit that the program reads and writes: as any client, with queue, limits, late windows, audit and rights.

    What it returns is the answer to its own request. Each method raises `NoResponse`, `Busy`, `LineDown` or `Refused`,
    which have the exception's `code`. Cancelling drops a request that waits; what was sent stays sent.
    """

    def __init__(self, operator: Operator, unit: int, name: str) -> None:
        """Use `Gateway.unit` to get one."""
        self.name: Final = name
        self._operator = operator
        self._unit = unit
        self._loop = asyncio.get_running_loop()

    async def request(self, pdu: bytes) -> bytes:
        """Send a request PDU, and return the response PDU."""
        return await self._over(self._request(pdu))

    async def read_holding(self, address: int, count: int = 1) -> list[int]:
        """Read `count` holding registers from `address` on, as 0-65535."""
        return await self._read(Area.HOLDING, address, count)

    async def read(self, point: str) -> Reading:
        """Read a point by its name."""
        raise NotImplementedError

    async def _read(self, area: Area, address: int, count: int) -> list[int]:
        span = Span(area, address, count)
        items = items_read(span, await self.request(read_request(span)))
        return [int.from_bytes(items[at : at + 2], "big") for at in range(0, len(items), 2)]

    async def _request(self, pdu: bytes, in_one_turn: int = 0) -> bytes:
        loop = self._loop
        origin = AwaitedOrigin(lambda: True, CALLER)
        request = Request(self._unit, pdu, origin, loop.time())
        request.in_one_turn = in_one_turn
        self._operator.running.routers.embedded.submit(request, request.received_at)
        try:
            error, response = await origin.outcome
        except asyncio.CancelledError:
            request.give_up()
            raise
        if error is not None:
            raise error
        if response is None:
            return b""
        if response[0] & EXCEPTION_BIT:
            code = response[1]
            message = f"{self.name} answered with exception {code:02X}"
            raise _BY_CODE[code](message) if code in _BY_CODE else Refused(message, code)
        return response

    async def _over(self, work: Coroutine[Any, Any, T]) -> T:
        """Carry out `work` in the gateway's loop, from whichever loop it is awaited."""
        if asyncio.get_running_loop() is self._loop:
            return await work
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(work, self._loop))
