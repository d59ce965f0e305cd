"""A TCP connection's way to a server on this machine, which can be cut and held up as a network does it."""

import selectors
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Self


class Link:
    """Passes bytes between `port`, which is its own (0: any), and the server's port. In its context it listens.

    `cut` closes all connections and new ones at once; `hold` leaves them open and passes nothing on, as a lost route
    does; `mend` ends both, and what was held is passed on then.
    """

    def __init__(self, server: int, port: int = 0) -> None:
        self.port = port
        self._server = server
        self._held = self._cut = False
        self._pairs: dict[socket.socket, socket.socket] = {}

    def __enter__(self) -> Self:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self.port = self._listener.getsockname()[1]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._ours, self._theirs = socket.socketpair()
        self._selector.register(self._theirs, selectors.EVENT_READ)
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=f"link to {self._server}")
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ours.close()
        self._thread.join()
        for each in (self._listener, self._theirs, *self._pairs):
            each.close()
        self._selector.close()

    def cut(self) -> None:
        with self._changed():
            self._cut = True
            for each in [*self._pairs]:
                self._close(each)

    def hold(self) -> None:
        with self._changed():
            self._held = True

    def mend(self) -> None:
        with self._changed():
            self._held = self._cut = False

    @contextmanager
    def _changed(self) -> Iterator[None]:
        with self._lock:
            yield
        self._ours.send(b".")

    def _run(self) -> None:
        while True:
            ready = [key.fileobj for key, _ in self._selector.select()]
            with self._lock:
                for each in ready:
                    if each is self._theirs:
                        if not self._theirs.recv(64):
                            return
                        self._watch()
                    elif each is self._listener:
                        self._accept()
                    elif each in self._pairs and not self._held:
                        self._pass_on(each)

    def _watch(self) -> None:
        """Look at connections only while something may be passed on: what waits would wake it for ever."""
        for each in self._pairs:
            known = each in self._selector.get_map()
            if self._held and known:
                self._selector.unregister(each)
            elif not self._held and not known:
                self._selector.register(each, selectors.EVENT_READ)

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        if self._cut:
            client.close()
            return
        try:
            server = socket.create_connection(("127.0.0.1", self._server), timeout=1.0)
        except OSError:
            client.close()
            return
        self._pairs |= {client: server, server: client}
        self._watch()

    def _pass_on(self, source: socket.socket) -> None:
        try:
            data = source.recv(65536)
            if data:
                self._pairs[source].sendall(data)
        except OSError:
            data = b""
        if not data:
            self._close(source)

    def _close(self, one: socket.socket) -> None:
        other = self._pairs.pop(one, None)
        if other is None:
            return
        del self._pairs[other]
        for each in (one, other):
            if each in self._selector.get_map():
                self._selector.unregister(each)
            each.close()
