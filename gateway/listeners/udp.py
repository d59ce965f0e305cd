"""Modbus UDP: each datagram is one ADU with the header of Modbus TCP; the response goes to its sender."""

import asyncio
import socket
from dataclasses import dataclass
from functools import partial
from typing import Final, NamedTuple

from gateway import events
from gateway.listeners.admission import MADE_ROOM, NO_RIGHTS, NOT_MEANT, Admission
from gateway.listeners.client_counts import ClientCounts
from gateway.listeners.datagram import PeerAddress, receive, request_local_address, send_arguments
from gateway.listeners.hosts import join_host_port
from gateway.listeners.sessions.peer import Path, Peer
from gateway.listeners.settings import ListenSettings
from gateway.listeners.share_keys import ShareKeys
from gateway.listeners.sockets import OpenSockets, bind_sockets, find_addresses, is_meant, show_bound_address
from gateway.modbus import mbap
from gateway.modbus.codes import EXCEPTION_BIT
from gateway.ports.network import AddressInfo
from gateway.request import Caller
from gateway.routing.router import Router

#: Seconds between checks for idle peers.
SWEEP_STEP: Final = 0.25
#: The most datagrams read before the first of them is processed, as many as the kernel's buffer holds; also the most
#: that wait for the admission of their senders.
MOST_AT_ONCE: Final = 256
#: The reason for rejecting a peer before its turn.
_TOO_MANY_NEW: Final = "too many new clients at once"
#: The reason for forgetting a peer when its listener closes.
_STOPPING: Final = "the gateway is stopping"


class Arrived(NamedTuple):
    """A received request, and its socket."""

    sock: socket.socket
    adu: mbap.TcpFrame
    #: Whether it repeated one in progress when it was read; that may have been answered since.
    is_repeated: bool


@dataclass(slots=True)
class DatagramCounts(ClientCounts):
    """Counts of clients and of datagrams."""

    #: Datagrams that are not exactly one request. An exception response is one of them: if it were answered like a
    #: request with an unknown function, one forged datagram would bounce between two servers forever.
    malformed: int = 0
    #: Responses that the system refused.
    unsent: int = 0


class UdpListener:
    """One `[[listen]]` table with udp://: answers datagrams, forgets idle peers.

    Datagrams from an address without any right are dropped, and those that came through a wider socket of systemd for
    an address of another listener. At most `clients` peers are known at a time; `admission` decides which one is
    forgotten for a new one, and whose datagrams are dropped. That takes a while if many are known, so peers are
    admitted one by one, and everything else has its turn in between.
    """

    def __init__(self, settings: ListenSettings, router: Router, emit: events.Emit) -> None:
        self.settings = settings
        self.router = router
        self.emit = emit
        self.counts = DatagramCounts()
        self._peers: dict[PeerAddress, Peer] = {}
        #: Received requests, the latest of each identifier, until they are processed.
        self._arrived: dict[tuple[PeerAddress, int], Arrived] = {}
        #: Requests of peers that wait for admission. While there are any, the next admission is scheduled.
        self._waiting: dict[tuple[PeerAddress, int], Arrived] = {}
        self._is_finishing = False
        self._share_keys = ShareKeys()
        self._admission: Admission[Peer] = Admission()
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
        """Number of known peers."""
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
        """Look up the addresses to bind.

        Raises:
            ListenError: the host name cannot be resolved.
        """
        self._addresses = await find_addresses(self.settings, socket.SOCK_DGRAM)

    def bind(self, ready: OpenSockets | None = None) -> None:
        """Bind the addresses without reading yet; `ready` sockets for them are used.

        Raises:
            ListenError: one is in use, needs more rights, or does not belong to this machine.
        """
        self._sockets = bind_sockets(self.settings, self._addresses, ready)
        for sock in self._sockets:
            request_local_address(sock)

    def listen(self) -> None:
        """Do nothing: datagrams arrive and wait from `bind` on."""

    def start(self) -> None:
        """Accept requests."""
        loop = asyncio.get_running_loop()
        for sock in self._sockets:
            loop.add_reader(sock, self._readable, sock)
        self._sweep_later()
        self.emit(events.ListenerUp(self.settings.name, self.address))

    def finish(self) -> None:
        """Accept no further requests; arrived ones and those in progress are answered, unless others replace them."""
        for sock in self._sockets:
            self._readable(sock)
        self._is_finishing = True
        while self._waiting:
            self._admit_first()
            self._process()
        for peer in self._peers.values():
            peer.finish()

    def close(self) -> None:
        """Accept no more requests, and answer none."""
        if self._sweeping is not None:
            self._sweeping.cancel()
        for key in list(self._peers):
            self._remove(key, _STOPPING)
        self._arrived.clear()
        self._waiting.clear()
        for sock in self._sockets:
            asyncio.get_running_loop().remove_reader(sock)
            sock.close()
        self._sockets = []

    def _readable(self, sock: socket.socket) -> None:
        self._read(sock)
        self._process()

    def _read_first(self, sock: socket.socket) -> None:
        """Read arrived datagrams before a response is sent; they are processed soon."""
        self._read(sock)
        if self._arrived:
            asyncio.get_running_loop().call_soon(self._process)

    def _read(self, sock: socket.socket) -> None:
        """Keep arrived requests. One with the identifier of an earlier one replaces it."""
        for _ in range(MOST_AT_ONCE - len(self._arrived)):
            try:
                data, key = receive(sock)
            except OSError:
                return
            adu = mbap.decode(data)
            if adu is None or adu.pdu[0] & EXCEPTION_BIT:
                self.counts.malformed += 1
                continue
            peer = self._peers.get(key)
            is_repeated = peer is not None and peer.notice(adu)
            self._arrived[key, adu.transaction] = Arrived(sock, adu, is_repeated)

    def _process(self) -> None:
        """Process received requests. One that is read meanwhile may replace another that still waits."""
        now = asyncio.get_running_loop().time()
        for arrived in list(self._arrived):
            request = self._arrived.pop(arrived)
            key, _ = arrived
            peer = self._peers.get(key)
            try:
                if peer is not None:
                    peer.received(request.adu, now, is_repeated=request.is_repeated)
                elif not self._is_finishing:
                    self._await_admission(arrived, request, now)
            except Exception as error:  # noqa: BLE001 - the error boundary of a datagram
                self._failed(key, error)

    def _await_admission(self, arrived: tuple[PeerAddress, int], request: Arrived, now: float) -> None:
        """Keep a request until its sender is admitted."""
        key, _ = arrived
        why_not = self._permanent_refusal(request.sock, key)
        if not why_not and len(self._waiting) >= MOST_AT_ONCE and arrived not in self._waiting:
            why_not = _TOO_MANY_NEW
        if why_not:
            self._reject(key, why_not, now)
            return
        if not self._waiting:
            asyncio.get_running_loop().call_soon(self._admit_next)
        self._waiting[arrived] = request

    def _permanent_refusal(self, sock: socket.socket, key: PeerAddress) -> str:
        """Return why a sender is rejected even if there is room; empty if it is not.

        It is checked on arrival, so that the sender takes no place of others.
        """
        if not is_meant(key.asked_host, sock, self._addresses):
            return NOT_MEANT
        return "" if self.router.rights.admits(key.host) else NO_RIGHTS

    def _admit_next(self) -> None:
        """Admit one peer in each iteration of the event loop, and process its requests."""
        if self._waiting:
            self._admit_first()
        if self._waiting:
            asyncio.get_running_loop().call_soon(self._admit_next)
        self._process()

    def _admit_first(self) -> None:
        """Admit the peer that has waited longest, if possible; its requests are processed before all others."""
        key, _ = first = next(iter(self._waiting))
        sock = self._waiting[first].sock
        requests = {each: self._waiting.pop(each) for each in list(self._waiting) if each[0] == key}
        now = asyncio.get_running_loop().time()
        try:
            if why_not := self._admit(sock, key, now):
                for _ in requests:
                    self._reject(key, why_not, now)
            else:
                self._arrived = requests | self._arrived
        except Exception as error:  # noqa: BLE001 - the error boundary of an admission
            self._failed(key, error)

    def _admit(self, sock: socket.socket, key: PeerAddress, now: float) -> str:
        """Admit a peer. Return why it is rejected: the listener is full, or it has lost its rights; else empty."""
        client = join_host_port(key.host, key.port)
        caller = Caller(client, key.host, self._share_keys.of(key.host, now))
        if why_not := self._admission.make_room(caller, self.router.rights, self.settings, now, self._forget_replaced):
            return why_not
        peer = Peer(caller, router=self.router, settings=self.settings, path=self._path(sock, key))
        self._peers[key] = peer
        self._admission.enter(peer, now)
        self.counts.accepted += 1
        self.emit(events.ClientConnected(self.settings.name, client))
        return ""

    def _reject(self, key: PeerAddress, why_not: str, now: float) -> None:
        self.counts.add_rejection(key.host, why_not, now)
        self.emit(events.ClientRejected(self.settings.name, join_host_port(key.host, key.port), why_not))

    def _failed(self, key: PeerAddress, error: Exception) -> None:
        self.emit(events.PartFailed.of(f"client {join_host_port(key.host, key.port)}", error))

    def _path(self, sock: socket.socket, key: PeerAddress) -> Path:
        control, address = send_arguments(sock, key)

        def send(data: bytes) -> None:
            try:
                sock.sendmsg([data], control, 0, address)
            except OSError:  # as if lost on the network: the client repeats its request
                self.counts.unsent += 1

        return Path(partial(self._read_first, sock), send)

    def _forget_replaced(self, peer: Peer) -> None:
        self._remove(next(key for key, each in self._peers.items() if each is peer), MADE_ROOM)

    def _remove(self, key: PeerAddress, reason: str) -> None:
        peer = self._peers.pop(key)
        self._admission.leave(peer)
        self.emit(events.ClientClosed(self.settings.name, peer.caller.client, reason))
        peer.closed()

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
                    self._remove(key, "idle")
        self._sweep_later()
