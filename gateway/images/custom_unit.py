"""A unit made in Python: what its author writes."""
# ruff: noqa: ARG002 - what subclasses get

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from gateway.errors import IllegalFunction
from gateway.modbus.codes import Area

if TYPE_CHECKING:
    from gateway.library.unit_client import UnitClient

#: The attribute by which a unit finds others.
FIND: Final = "_CustomUnit__find"


class CustomUnit:
    """A unit whose registers and bits are made in Python: a subclass has `read`, and `write` if it can be written.

    Its requests are carried out one after the other. Each has a deadline, the `timeout` of its `[[image]]`, 1 s by
    default: then its client gets exception 0B, and the call is cancelled. Raise `IllegalAddress`, `IllegalValue` or
    another `RequestError` for the exception that it stands for; any other error is 04 for the client, and is logged.
    """

    #: Finds units of its gateway. Set before the first request, as FIND; subclasses may have a `_find` of their own.
    __find: "Callable[[int | str], Any] | None" = None

    async def read(self, area: Area, address: int, count: int) -> Sequence[int]:
        """Return `count` values from `address` on: registers as 0-65535, coils and discrete inputs as 0 or 1."""
        raise IllegalFunction("it cannot be read")

    async def write(self, area: Area, address: int, values: Sequence[int]) -> None:
        """Take new `values` of coils or holding registers, from `address` on."""
        raise IllegalFunction("it cannot be written")

    def unit(self, unit: int | str) -> "UnitClient":
        """Return another unit of the gateway, by number or name: see `Gateway.unit`.

        Raises:
            NotConfigured: there is none.
            RuntimeError: this one belongs to no gateway that has been started.
        """
        if self.__find is None:
            raise RuntimeError("this unit belongs to no gateway that has been started")
        client: UnitClient = self.__find(unit)
        return client
