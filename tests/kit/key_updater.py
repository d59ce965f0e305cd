"""A TLS 1.3 client that changes its keys, which Python's ssl cannot: OpenSSL itself, in this process."""

import ctypes
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from kit.pki import pki
from kit.process import PATIENCE

_PEM, _NOT_ASKING_FOR_THEIRS, _TLS_1_3 = 1, 0, 0x0304


class KeyUpdater:
    """One connection."""

    def __init__(self, library: ctypes.CDLL, tls: ctypes.c_void_p) -> None:
        self._library = library
        self._tls = tls

    def update(self, times: int) -> bool:
        """Send so many KeyUpdates; False when the connection is closed."""
        for _ in range(times):
            self._library.SSL_key_update(self._tls, _NOT_ASKING_FOR_THEIRS)
            if self._library.SSL_do_handshake(self._tls) != 1:
                return False
        return True

    def send(self, data: bytes) -> None:
        assert self._library.SSL_write(self._tls, data, len(data)) == len(data)

    def receive(self) -> bytes:
        room = ctypes.create_string_buffer(1000)
        count = self._library.SSL_read(self._tls, room, len(room))
        return room.raw[: max(count, 0)]


@contextmanager
def key_updater(port: int, name: str) -> Iterator[KeyUpdater]:
    """A client with this certificate."""
    try:
        library = ctypes.CDLL("libssl.so.3")
    except OSError:
        pytest.skip("OpenSSL 3 is not a library of this system")
    for function in ("TLS_client_method", "SSL_CTX_new", "SSL_new"):
        getattr(library, function).restype = ctypes.c_void_p
    context = ctypes.c_void_p(library.SSL_CTX_new(ctypes.c_void_p(library.TLS_client_method())))
    files = (pki() / f"{name}.crt", pki() / f"{name}.key")
    assert library.SSL_CTX_use_certificate_chain_file(context, bytes(files[0])) == 1
    assert library.SSL_CTX_use_PrivateKey_file(context, bytes(files[1]), _PEM) == 1
    tls = ctypes.c_void_p(library.SSL_new(context))
    with socket.create_connection(("127.0.0.1", port), PATIENCE) as sock:
        sock.settimeout(None)
        library.SSL_set_fd(tls, sock.fileno())
        try:
            assert library.SSL_connect(tls) == 1
            assert library.SSL_version(tls) == _TLS_1_3
            yield KeyUpdater(library, tls)
        finally:
            library.SSL_free(tls)
            library.SSL_CTX_free(context)
