"""A library that is deferred is loaded by its first use."""

import subprocess
import sys

import pytest

DEFERRED = """
import sys
from gateway.readconfig.deferred import LIBRARIES, defer
defer(*LIBRARIES)
import asyncio, socket, ssl, sqlite3, hashlib
def loaded(): return [name for name in ("_ssl", "_hashlib", "_sqlite3") if name in sys.modules]
"""


def run(script: str) -> str:
    command = [sys.executable, "-P", "-c", DEFERRED + script]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout.strip()


def test_an_import_and_sockets_load_nothing():
    script = """
async def main():
    ours, others = socket.socketpair()
    ours.setblocking(False)
    await asyncio.get_running_loop().sock_sendall(ours, b"x")
    assert not isinstance(ours, ssl.SSLSocket)
asyncio.run(main())
print(loaded())"""
    assert run(script) == "[]"


@pytest.mark.parametrize(
    ("use", "library"),
    [
        ("ssl.SSLContext", "_ssl"),
        ("from ssl import CERT_NONE", "_ssl"),
        ("hashlib.sha256()", "_hashlib"),
        ("sqlite3.connect(':memory:').execute('SELECT 1').fetchone()[0]", "_sqlite3"),
    ],
)
def test_the_first_use_loads_it(use, library):
    assert library in run(f"{use}\nprint(loaded())")


def test_a_library_that_cannot_be_loaded_is_tried_again_and_plain_sockets_work():
    script = """
sys.modules["_ssl"] = None  # cannot be imported
async def main():
    ours, others = socket.socketpair()
    ours.setblocking(False)
    for _ in range(2):
        try:
            ssl.SSLContext
        except ImportError:
            await asyncio.get_running_loop().sock_sendall(ours, b"x")
            print(sys.modules["ssl"] is ssl)
    del sys.modules["_ssl"]
    print(ssl.SSLContext is sys.modules["ssl"].SSLContext, ssl.SSLSocket is sys.modules["ssl"].SSLSocket)
asyncio.run(main())"""
    assert run(script).split() == ["True"] * 4


def test_asyncio_has_tls_as_always_afterwards():
    script = """
asyncio.selector_events.sslproto.SSLProtocol
context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
async def main():
    async def closes(reader, writer):
        writer.close()
    server = await asyncio.start_server(closes, "127.0.0.1", 0)
    try:
        await asyncio.open_connection(*server.sockets[0].getsockname(), ssl=context)
    except (ssl.SSLError, ConnectionError) as error:
        print(type(error).__name__, ssl.SSLSocket is sys.modules["ssl"].SSLSocket)
asyncio.run(main())"""
    assert run(script).split() in (["ConnectionResetError", "True"], ["SSLEOFError", "True"])
