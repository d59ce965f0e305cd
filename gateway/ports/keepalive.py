"""Keep-alive of TCP: a peer that vanishes, with its network or its power, is noticed."""

import socket


def notice_vanished_peers(sock: socket.socket, *, idle: int, interval: int, probes: int, user_timeout: int) -> None:
    """Give up a peer of whom nothing came for `idle` seconds and who then answers none of so many `probes`.

    They are `interval` seconds apart. One that acknowledges nothing of what is sent to it is given up after
    `user_timeout` milliseconds. Connections that a listening socket accepts inherit all that.
    """
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, idle)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPINTVL, interval)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPCNT, probes)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, user_timeout)
