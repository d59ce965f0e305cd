"""Datagrams with the local address that each was sent to: the response must come from there."""

import socket
from typing import Any, Final, NamedTuple

from gateway.listeners.hosts import IPV4_MAPPED, show_host
from gateway.modbus.codes import MAX_TCP_ADU

#: Room for the ancillary data of a datagram: `struct in6_pktinfo` and more.
_ANCILLARY_SIZE: Final = 128
#: From linux/in.h; Python has it from 3.14 on.
_IP_PKTINFO: Final = 8
#: Any interface: at the beginning of `struct in_pktinfo`, at the end of `struct in6_pktinfo`. The route of a response
#: may use another one.
_NO_INTERFACE: Final = bytes(4)
_NO_HEADER_ADDRESS: Final = bytes(4)
_IPV4_SIZE: Final = 4
#: The prefix of an IPv4 address in IPv6.
_MAPPED: Final = bytes(10) + b"\xff\xff"


class PeerAddress(NamedTuple):
    """The source of a datagram and its destination, alike for sockets of both families."""

    host: str
    port: int
    scope: int
    #: The local address that it was sent to, packed.
    asked: bytes

    @property
    def asked_host(self) -> str:
        """The local address that the peer has used."""
        return socket.inet_ntop(socket.AF_INET if len(self.asked) == _IPV4_SIZE else socket.AF_INET6, self.asked)


def request_local_address(sock: socket.socket) -> None:
    """Make the system report where each datagram was sent to."""
    if sock.family == socket.AF_INET6:
        sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_RECVPKTINFO, 1)
    else:
        sock.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)


def receive(sock: socket.socket) -> tuple[bytes, PeerAddress]:
    """Receive the next datagram, at most one byte more than an ADU, and its peer.

    Raises:
        OSError: none has arrived, or its checksum was wrong.
    """
    data, ancillary, _, address = sock.recvmsg(MAX_TCP_ADU + 1, _ANCILLARY_SIZE)
    asked = ancillary[0][2]
    if sock.family == socket.AF_INET:
        host, port = address
        return data, PeerAddress(host, port, 0, asked[4:8])
    host, port, _, scope = address
    return data, PeerAddress(show_host(host), port, scope, asked[:16].removeprefix(_MAPPED))


def send_arguments(sock: socket.socket, peer: PeerAddress) -> tuple[list[tuple[int, int, bytes]], tuple[Any, ...]]:
    """Make the arguments of `sock.sendmsg` for responses to `peer`: the ancillary data with the source; the address."""
    if sock.family == socket.AF_INET:
        source = _NO_INTERFACE + peer.asked + _NO_HEADER_ADDRESS
        return [(socket.IPPROTO_IP, _IP_PKTINFO, source)], (peer.host, peer.port)
    is_ipv4 = len(peer.asked) == _IPV4_SIZE
    source = (_MAPPED + peer.asked if is_ipv4 else peer.asked) + _NO_INTERFACE
    host = IPV4_MAPPED + peer.host if is_ipv4 else peer.host
    return [(socket.IPPROTO_IPV6, socket.IPV6_PKTINFO, source)], (host, peer.port, 0, peer.scope)
