"""What a client of the web page sends at once is handled in small pieces, so that other clients have their turn."""

import asyncio
import socket
import ssl

import pytest

from gateway.tls.contexts import load
from gateway.tls.settings import SecretFile, ServerTls
from gateway.web.front.connections import Connections
from gateway.web.front.pieces import PIECE
from kit.pki import pki
from kit.process import PATIENCE

AT_ONCE = b"1\r\na\r\n" * 50_000


class Parser(asyncio.Protocol):
    """Counts what it is given in each turn of the event loop."""

    def __init__(self) -> None:
        self.in_turns = [0]
        self.done = asyncio.Event()
        self.lost = asyncio.Event()

    def data_received(self, data: bytes) -> None:
        self.in_turns[-1] += len(data)
        if sum(self.in_turns) == len(AT_ONCE):
            self.done.set()

    def connection_lost(self, exc: Exception | None) -> None:
        self.lost.set()

    async def count_turns(self) -> None:
        while not self.done.is_set():
            self.in_turns.append(0)
            await asyncio.sleep(0)


def server_tls() -> ssl.SSLContext:
    return load(ServerTls(*(SecretFile(str(pki() / name)) for name in ("server.crt", "server.key")))).context


def client_tls() -> ssl.SSLContext:
    return ssl.create_default_context(cafile=str(pki() / "ca.crt"))


@pytest.mark.parametrize("is_encrypted", [False, True])
async def test_a_client_that_sends_much_at_once_is_handled_a_piece_in_a_turn(is_encrypted):
    parser = Parser()
    connections = Connections(lambda: parser)
    ours, theirs = socket.socketpair()
    loop = asyncio.get_running_loop()
    encryption = {"ssl": client_tls(), "server_hostname": "localhost"} if is_encrypted else {}
    await loop.connect_accepted_socket(lambda: connections.connected(server_tls if is_encrypted else None), ours)
    _, client = await asyncio.open_connection(sock=theirs, **encryption)
    try:
        client.write(AT_ONCE)
        async with asyncio.timeout(PATIENCE):
            await parser.count_turns()
    finally:
        client.transport.abort()
        await parser.lost.wait()
        connections.close()
    assert max(parser.in_turns) <= (2 * PIECE if is_encrypted else PIECE)  # what waits for the end of its record
