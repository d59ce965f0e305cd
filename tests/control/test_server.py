"""The control socket's deadlines, in virtual time. Real sockets: tests/system/test_control_socket.py."""

import asyncio

from gateway.control.server import _serve_connection


class Transport:
    aborted = False
    keeps = 64 * 1024

    def set_write_buffer_limits(self, high: int) -> None:
        self.keeps = high

    def abort(self) -> None:
        self.aborted = True


class Writer:
    """A client's side of the connection; `takes` its answers or leaves them."""

    def __init__(self, *, takes: bool = True) -> None:
        self.transport = Transport()
        self.written: list[bytes] = []
        self._takes = takes

    def write(self, data: bytes) -> None:
        self.written.append(data)

    async def drain(self) -> None:
        if not self._takes and sum(map(len, self.written)) > self.transport.keeps:
            await asyncio.Event().wait()

    def close(self) -> None:
        pass


async def spoken(writer: Writer, *lines: bytes) -> float:
    """How long a conversation lasts in which the client says `lines` and then nothing."""
    reader = asyncio.StreamReader()
    reader.feed_data(b"".join(lines))
    loop = asyncio.get_running_loop()
    begun = loop.time()
    await _serve_connection(reader, writer, None, {}, [].append)
    return loop.time() - begun


async def test_who_asks_nothing_is_cut_after_a_minute() -> None:
    silent = Writer()
    assert await spoken(silent) == 60.0
    assert silent.transport.aborted


async def test_who_takes_no_answer_is_cut_after_a_minute() -> None:
    deaf = Writer(takes=False)
    assert await spoken(deaf, b"{}\n", b"{}\n") == 60.0
    assert len(deaf.written) == 1
    assert deaf.transport.aborted
