"""Opens a connection to a server with several addresses: the next one is tried when one cannot be reached."""

import asyncio
from collections.abc import Callable, Mapping

from gateway.errors import PortError
from gateway.ports.port import OpenPort, Port, PortUser
from gateway.ports.reconnector import OPENING_DEADLINE
from gateway.ports.tcp import CONNECTING_DEADLINE, NO_ANSWER


class Addresses:
    """The addresses of one server, by their names in messages, and how a connection to each is opened.

    The one that was used last is tried first, the first one at the beginning. In each attempt all are tried, and the
    last one has as much time as if it was the only one; each is the last one of some attempt. `moved` is called with
    the address that is used, or tried, from then on. Nothing leads back to the first one but a failure of another.
    """

    def __init__(self, openers: Mapping[str, OpenPort], after_connect: float = 0.0) -> None:
        self.moved: Callable[[str], None] = lambda _: None
        self._openers = openers
        self._paths = list(openers)
        share = CONNECTING_DEADLINE / len(openers)
        self._time_for_each = share + after_connect
        #: How long an attempt may take, in seconds.
        self.deadline = OPENING_DEADLINE + after_connect + (len(openers) - 1) * self._time_for_each

    @property
    def are_several(self) -> bool:
        """Whether there is more than one."""
        return len(self._paths) > 1

    def next(self) -> str:
        """Use the next address from now on; return it."""
        self._paths.append(self._paths.pop(0))
        self.moved(self._paths[0])
        return self._paths[0]

    async def open(self, user: PortUser) -> Port:
        """Connect to the first of the addresses that can be reached.

        Raises:
            PortError: none of them can; the message says why.
        """
        reasons: list[str] = []
        for path in self._paths[:-1]:
            try:
                async with asyncio.timeout(self._time_for_each):
                    return await self._openers[path](user)
            except TimeoutError:
                reasons.append(NO_ANSWER.format(port=path))
            except PortError as error:
                reasons.append(str(error))
            self.next()
        try:
            return await self._openers[self._paths[0]](user)
        except PortError as error:  # the next attempt begins here, so that another one is the last
            raise PortError("; ".join(sorted({*reasons, str(error)}))) from error
