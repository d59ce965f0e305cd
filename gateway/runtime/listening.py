"""The listeners of a running gateway: bound, replaced by those of another config, and closed."""

import asyncio
from collections.abc import Iterable, Sequence

from gateway.errors import ListenError
from gateway.listeners.sockets import OpenSockets
from gateway.listeners.udp import UdpListener
from gateway.runtime.draining import until
from gateway.runtime.gateway import Listener


class Listening:
    """Owns the sockets of listeners; `sockets` are those that were bound before the process started."""

    def __init__(self, sockets: OpenSockets) -> None:
        self._sockets = sockets
        #: Listeners that were removed from the config and still have clients.
        self._leaving: list[Listener] = []

    async def bind(self, listeners: Sequence[Listener]) -> None:
        """Bind the addresses of the first listeners.

        Raises:
            ListenError: one of them cannot be used, or an inherited socket belongs to no listener.
        """
        await self._bind(listeners, self._sockets, listeners)

    async def take_addresses(
        self, gone: Sequence[Listener], come: Sequence[Listener], present: Sequence[Listener]
    ) -> None:
        """Listen at the addresses of those that `come`, replacing those of `gone`; `present` are all from then on.

        Raises:
            ListenError: as `bind`; nothing has changed.
        """
        sockets = OpenSockets(self._sockets.all, leaving=(sock for one in gone for sock in one.sockets))
        try:
            await self._bind(come, sockets, present)
            for listener in come:
                listener.listen()
        except ListenError:
            for listener in come:
                listener.close()
            sockets.put_back()
            raise

    def finish(self, gone: Iterable[Listener]) -> None:
        """Take no more requests from clients of listeners that are gone; responses in progress may still be sent."""
        for listener in gone:
            if isinstance(listener, UdpListener):
                listener.close()  # its successor hears the clients; it cannot know which responses they still wait for
            else:
                listener.finish()

    def start(self, come: Iterable[Listener]) -> None:
        """Accept clients."""
        for listener in come:
            listener.start()

    def retire(self, gone: Iterable[Listener], group: asyncio.TaskGroup) -> None:
        """Close listeners that are gone, each once its clients have their responses."""
        self._leaving += gone
        for listener in gone:
            group.create_task(self._retire(listener), name=f"retire:{listener.settings.name}")

    def all_with(self, present: Sequence[Listener]) -> Sequence[Listener]:
        """List all listeners that may have clients: those `present`, and those that are leaving."""
        return (*present, *self._leaving)

    async def _retire(self, listener: Listener) -> None:
        await until(lambda: not listener.has_clients)
        listener.close()
        self._leaving.remove(listener)

    async def _bind(self, come: Sequence[Listener], sockets: OpenSockets, present: Sequence[Listener]) -> None:
        for error in await asyncio.gather(*(listener.find() for listener in come), return_exceptions=True):
            if error is not None:
                raise error
        for listener in come:
            listener.bind(sockets)
        self._check_inherited_sockets(present)

    def _check_inherited_sockets(self, present: Sequence[Listener]) -> None:
        """Check that each inherited socket belongs to a listener: otherwise its clients would wait for ever."""
        left_over = self._sockets.list_unused(sock for one in present for sock in one.sockets)
        if left_over:
            advice = "add one, or take it out of modbus-gateway.socket, then systemctl restart modbus-gateway.socket"
            raise ListenError(f"systemd has opened {', '.join(left_over)}, which no [[listen]] names; {advice}")
