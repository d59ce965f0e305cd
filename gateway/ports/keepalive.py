"""TCP keep-alive: detects a peer that has lost its network or its power."""

import socket


def notice_vanished_peers(sock: socket.socket, *, idle: int, interval: int, probes: int, user_timeout: int) -> None:
    """Close the connection to a peer that sends nothing for `idle` seconds and then answers none of the `probes`.

    They are `interval` seconds apart. A peer that does not acknowledge what is sent to it has `user_timeout`
    milliseconds. Connections that a listening socket accepts inherit these options.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, idle)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, interval)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, probes)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, user_timeout)
