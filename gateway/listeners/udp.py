"""Modbus UDP: each datagram is one ADU with the header of Modbus TCP; the response goes to its sender."""

import asyncio
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from gateway import events
from gateway.listeners.admission import MADE_ROOM, Admission
from gateway.listeners.origin import Origins
from gateway.listeners.peer import Peer, UnderWay
from gateway.listeners.rejections import Rejections
from gateway.listeners.session import Counts, ListenSettings
from gateway.listeners.sockets import (
    OpenSockets,
    addresses,
    bind_sockets,
    join_host_port,
    show_bound_address,
    show_host,
)
from gateway.modbus import mbap
from gateway.modbus.codes import EXCEPTION_BIT, MAX_TCP_ADU
from gateway.ports.lookup import AddressInfo
from gateway.routing.router import Router

#: How often a listener looks for idle peers, in seconds.
SWEEP_STEP: Final = 0.25

#: Room for the ancillary data of a datagram: `struct in6_pktinfo` and more.
_ANCILLARY_SIZE: Final = 128
#: From linux/in.h; Python has it from 3.14 on.
_IP_PKTINFO: Final = 8
#: Any interface, in `struct in_pktinfo` at the beginning, in `struct in6_pktinfo` at the end.
_NO_INTERFACE: Final = bytes(4)

#: Ancillary data of `recvmsg`: the local address that a datagram was sent to; `sendmsg` takes the same.
Asked = list[tuple[int, int, bytes]]
#: The address of a peer, and what it has asked: `Asked`.
PeerKey = tuple[Any, ...]


@dataclass(slots=True)
class DatagramCounts(Counts):
    """Also counts datagrams: `unsent` are responses that the system refused.

    `malformed` are those that are not exactly one request. An exception response is malformed too: answered like a
    request with an unknown function, one forged datagram would bounce between two servers for ever.
    """

    malformed: int = 0
    unsent: int = 0


class UdpListener:
    """One `[[listen]]` table with udp://: answers datagrams, forgets idle peers.

    Datagrams from an address without any right are dropped. At most `clients` peers are known at a time; `admission`
    decides which one is forgotten for a new one, and whose datagrams are dropped.
    """

    def __init__(self, settings: ListenSettings, router: Router, emit: events.Emit) -> None:
        self.settings = settings
        self.router = router
        self.emit = emit
        self.counts = DatagramCounts()
        self.rejections = Rejections()
        self._peers: dict[PeerKey, Peer] = {}
        #: What the peers of an earlier listener at this address have in progress, until they are heard again.
        self._inherited: dict[PeerKey, UnderWay] = {}
        self._is_finishing = False
        self._admission: Admission[Peer] = Admission(Origins().of)
        self._addresses: list[AddressInfo] = []
        self._sockets: list[socket.socket] = []
        self._sweeping: asyncio.TimerHandle | None = None

    @property
    def address(self) -> str:
        """The bound address, `udp://127.0.0.1:5020`; the configured one while it is not bound."""
        return show_bound_address(self.settings, self._sockets)

    @property
    def sockets(self) -> tuple[socket.socket, ...]:
        """The bound sockets: another listener at the same address can take them over."""
        return tuple(self._sockets)

    @property
    def clients(self) -> int:
        """The number of known peers."""
        return len(self._peers)

    @property
    def connected_clients(self) -> tuple[Peer, ...]:
        """The known peers."""
        return tuple(self._peers.values())

    @property
    def has_clients(self) -> bool:
        """Whether any peer has a request in progress."""
        return not all(peer.is_idle for peer in self._peers.values())

    async def find(self) -> None:
        """Look up the addresses to be bound.

        Raises:
            ListenError: the host name cannot be resolved.
        """
        self._addresses = await addresses(self.settings, socket.SOCK_DGRAM)

    def bind(self, ready: OpenSockets | None = None) -> None:
        """Bind the addresses without reading yet; sockets that are `ready` for them are used.

        Raises:
            ListenError: one is in use, needs more rights, or is no address of this machine.
        """
        self._sockets = bind_sockets(self.settings, self._addresses, ready)
        for sock in self._sockets:
            _request_local_address(sock)

    def listen(self) -> None:
        """Does nothing: datagrams arrive and wait from `bind` on."""

    def follow(self, earlier: Iterable["UdpListener"]) -> None:
        """Take the place of those that finish at this address: what a peer has in progress there counts here, too.

        So a datagram that is repeated is not executed again, and another request replaces the one with its identifier.
        """
        for listener in earlier:
            self._inherited |= listener.hand_over(self._sockets)

    def hand_over(self, sockets: Iterable[socket.socket]) -> dict[PeerKey, UnderWay]:
        """What peers have in progress, for a listener whose `sockets` are at this address, which reads from now on."""
        names = {sock.getsockname() for sock in self._sockets}
        if names.isdisjoint(sock.getsockname() for sock in sockets):
            return {}
        self._stop_reading()
        return self._inherited | {key: peer.under_way for key, peer in self._peers.items() if not peer.is_idle}

    def start(self) -> None:
        """Take requests."""
        loop = asyncio.get_running_loop()
        for sock in self._sockets:
            loop.add_reader(sock, self._readable, sock)
        self._sweep_later()
        self.emit(events.ListenerUp(self.settings.name, self.address))

    def finish(self) -> None:
        """Take no more requests; those in progress are still answered, unless others replace them."""
        self._is_finishing = True
        for peer in self._peers.values():
            peer.finish()

    def close(self) -> None:
        """Take no more requests and answer none."""
        self._stop_reading()
        if self._sweeping is not None:
            self._sweeping.cancel()
        for key in list(self._peers):
            self._forget(key, "the gateway is stopping")
        for sock in self._sockets:
            sock.close()
        self._sockets = []

    def _stop_reading(self) -> None:
        loop = asyncio.get_running_loop()
        for sock in self._sockets:
            loop.remove_reader(sock)

    def _readable(self, sock: socket.socket) -> None:
        """Process one datagram; the loop calls again for the next one, after it has served all others."""
        try:
            data, asked, _, address = sock.recvmsg(MAX_TCP_ADU + 1, _ANCILLARY_SIZE)
        except OSError:  # no datagram after all: its checksum was wrong
            return
        try:
            self._received(sock, data, asked, address)
        except Exception as error:  # noqa: BLE001 - the error boundary of a datagram
            self.emit(events.PartFailed.of(f"client {join_host_port(*address[:2])}", error))

    def _received(self, sock: socket.socket, data: bytes, asked: Asked, address: tuple[Any, ...]) -> None:
        adu = mbap.decode(data)
        if adu is None or adu.pdu[0] & EXCEPTION_BIT:
            self.counts.malformed += 1
            return
        now = asyncio.get_running_loop().time()
        peer = self._peer(sock, asked, address, now)
        if peer is not None:
            peer.received(adu, now)

    def _peer(self, sock: socket.socket, asked: Asked, address: tuple[Any, ...], now: float) -> Peer | None:
        """The sender of a datagram; None if it has no rights, or the listener is full or finishing."""
        key = (*address, *asked)
        peer = self._peers.get(key)
        if peer is not None or self._is_finishing:
            return peer
        client, host = join_host_port(*address[:2]), show_host(address[0])
        why_not = self._admission.refusal(host, self.router.rights, self.settings, now, self._dismiss)
        if why_not:
            self.counts.rejected += 1
            self.rejections.add(host, why_not, now)
            self.emit(events.ClientRejected(self.settings.name, client, why_not))
            return None
        send = partial(self._send, sock, _reply_control(asked), address)
        peer = Peer(
            client,
            host=host,
            router=self.router,
            send=send,
            in_flight=self.settings.in_flight,
            on_failure=self.settings.on_failure,
            under_way=self._inherited.pop(key, None),
        )
        self._peers[key] = peer
        self._admission.enter(peer, now)
        self.counts.accepted += 1
        self.emit(events.ClientConnected(self.settings.name, client))
        return peer

    def _send(self, sock: socket.socket, asked: Asked, address: tuple[Any, ...], data: bytes) -> None:
        try:
            sock.sendmsg([data], asked, 0, address)
        except OSError:  # as if lost on the network: the client repeats its request
            self.counts.unsent += 1

    def _dismiss(self, peer: Peer) -> None:
        self._forget(next(key for key, each in self._peers.items() if each is peer), MADE_ROOM)

    def _forget(self, key: PeerKey, reason: str) -> None:
        peer = self._peers.pop(key)
        self._admission.leave(peer, asyncio.get_running_loop().time())
        peer.closed()
        self.emit(events.ClientClosed(self.settings.name, peer.client, reason))

    def _sweep_later(self) -> None:
        self._sweeping = asyncio.get_running_loop().call_later(SWEEP_STEP, self._sweep)

    def _sweep(self) -> None:
        """Forget the peers that have been idle for too long."""
        now = asyncio.get_running_loop().time()
        self._admission.look(now)
        since = now - self.settings.idle
        if self.settings.idle:
            for key, peer in list(self._peers.items()):
                if peer.is_idle and peer.last_asked <= since:
                    self._forget(key, "idle")
        self._sweep_later()


def _request_local_address(sock: socket.socket) -> None:
    if sock.family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_RECVPKTINFO, 1)
    else:
        sock.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)


def _reply_control(asked: Asked) -> Asked:
    """The local address as source of the response, without the interface: the route may use another one."""
    return [
        (level, kind, _NO_INTERFACE + data[4:] if level == socket.IPPROTO_IP else data[:-4] + _NO_INTERFACE)
        for level, kind, data in asked
    ]
