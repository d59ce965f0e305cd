"""Connections to the web page on real sockets: clients that do not read, and handshakes that do not end."""

import asyncio
import socket
import ssl
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from threading import current_thread

import pytest

from gateway.listeners.handshakes import MOST
from gateway.listeners.tls_stream import TlsStream
from gateway.web.front import connections
from gateway.web.front.connections import MOST_CONNECTIONS, listen
from kit.browser import WebBench, web_bench
from kit.pki import pki
from kit.process import PATIENCE

CONFIG = """
[[image]]
unit = 200
holding = 20
"""
ASK = b"GET %s HTTP/1.1\r\nHost: localhost\r\n\r\n"
LOCALHOST, OTHER = "127.0.0.1", "127.0.0.66"


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[WebBench]:
    async with web_bench(CONFIG, tmp_path) as bench:
        yield bench


@pytest.fixture
async def opened() -> AsyncIterator[ExitStack]:
    """What is closed at the end."""
    with ExitStack() as stack:
        yield stack


def number(bench: WebBench) -> int:
    """How many connections the server has."""
    return sum(each.is_open for each in bench.connect.__self__._open)


async def until_none(bench: WebBench) -> None:
    while number(bench):  # noqa: ASYNC110 - the server tells nobody
        await asyncio.sleep(0.05)


def server_tls() -> Callable[[], ssl.SSLContext]:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(pki() / "server.crt", pki() / "server.key")
    return lambda: tls


async def open_connection(
    port: int, host: str = LOCALHOST, *, is_secure: bool = False
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    tls = ssl.create_default_context(cafile=str(pki() / "ca.crt")) if is_secure else None
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    sock.setblocking(False)
    sock.bind((host, 0))
    await asyncio.get_running_loop().sock_connect(sock, (LOCALHOST, port))
    name = "localhost" if is_secure else None
    return await asyncio.open_connection(sock=sock, ssl=tls, server_hostname=name, limit=1024)


async def test_a_crowd_is_accepted_one_in_a_turn_of_the_loop(bench: WebBench, opened: ExitStack) -> None:
    acceptor = await listen(LOCALHOST, 0, partial(bench.connect, None))
    opened.callback(acceptor.stop)
    for _ in range(20):
        opened.enter_context(socket.create_connection(acceptor.sockets[0].getsockname()))
    async with asyncio.timeout(PATIENCE):
        while (before := number(bench)) < 20:
            await asyncio.sleep(0)
            assert number(bench) - before <= 1


@pytest.mark.parametrize("is_secure", [False, True])
async def test_a_response_that_nobody_reads_ends_its_connection(
    bench: WebBench, monkeypatch: pytest.MonkeyPatch, opened: ExitStack, is_secure: bool
) -> None:
    monkeypatch.setattr(connections, "UNREAD_FOR", 1)
    acceptor = await listen(LOCALHOST, 0, partial(bench.connect, server_tls() if is_secure else None))
    opened.callback(acceptor.stop)
    async with asyncio.timeout(PATIENCE):
        _, writer = await open_connection(acceptor.sockets[0].getsockname()[1], is_secure=is_secure)
        opened.callback(writer.close)
        while number(bench) != 1:  # noqa: ASYNC110 - the server tells nobody
            await asyncio.sleep(0)
        writer.transport.pause_reading()
        writer.write(ASK % b"/api/v1/openapi.json" * 200)
        await until_none(bench)


async def test_one_address_does_not_keep_others_out_with_handshakes(
    bench: WebBench, monkeypatch: pytest.MonkeyPatch, opened: ExitStack
) -> None:
    monkeypatch.setattr(connections, "FIRST_REQUEST_WITHIN", PATIENCE)
    acceptor = await listen(LOCALHOST, 0, partial(bench.connect, server_tls()))
    opened.callback(acceptor.stop)
    address = acceptor.sockets[0].getsockname()
    async with asyncio.timeout(PATIENCE):
        for _ in range(MOST_CONNECTIONS + 10):
            _, silent = await open_connection(address[1], OTHER)
            opened.callback(silent.close)
        reader, writer = await open_connection(address[1], is_secure=True)
        opened.callback(writer.close)
        writer.write(ASK % b"/healthz")
        assert await reader.readline() == b"HTTP/1.1 200 OK\r\n"
        assert number(bench) == MOST


async def test_handshakes_are_done_beside_the_loop(
    bench: WebBench, monkeypatch: pytest.MonkeyPatch, opened: ExitStack
) -> None:
    threads = set[str]()
    step = TlsStream.step

    def watched(stream: TlsStream) -> str | None:
        threads.add(current_thread().name)
        return step(stream)

    monkeypatch.setattr(TlsStream, "step", watched)
    acceptor = await listen(LOCALHOST, 0, partial(bench.connect, server_tls()))
    opened.callback(acceptor.stop)
    async with asyncio.timeout(PATIENCE):
        reader, writer = await open_connection(acceptor.sockets[0].getsockname()[1], is_secure=True)
        opened.callback(writer.close)
        writer.write(ASK % b"/healthz")
        assert await reader.readline() == b"HTTP/1.1 200 OK\r\n"
    assert {name.rpartition("_")[0] for name in threads} == {"tls handshakes"}


async def test_a_handshake_that_is_not_done_in_time_is_ended(
    bench: WebBench, monkeypatch: pytest.MonkeyPatch, opened: ExitStack
) -> None:
    monkeypatch.setattr(connections, "FIRST_REQUEST_WITHIN", 0.1)
    acceptor = await listen(LOCALHOST, 0, partial(bench.connect, server_tls()))
    opened.callback(acceptor.stop)
    async with asyncio.timeout(PATIENCE):
        reader, writer = await open_connection(acceptor.sockets[0].getsockname()[1])
        opened.callback(writer.close)
        assert await reader.read() == b""
        await until_none(bench)


async def test_a_handshake_that_fails_leaves_nothing_behind(bench: WebBench, opened: ExitStack) -> None:
    acceptor = await listen(LOCALHOST, 0, partial(bench.connect, server_tls()))
    opened.callback(acceptor.stop)
    async with asyncio.timeout(PATIENCE):
        reader, writer = await open_connection(acceptor.sockets[0].getsockname()[1])
        opened.callback(writer.close)
        writer.write(ASK % b"/healthz")
        assert not (await reader.read()).startswith(b"HTTP")
        await until_none(bench)
