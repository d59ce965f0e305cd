"""The control socket with clients of every kind: none holds up the others, and each hears why it gets nothing."""

import asyncio
import json
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack, asynccontextmanager, contextmanager
from pathlib import Path
from socket import AF_UNIX, socket
from threading import Thread
from typing import Any

import pytest

from gateway.cli.kit import daemon as daemon_module
from gateway.cli.kit.daemon import Conversation, Meant
from gateway.control.server import MOST_CONNECTIONS, control_open
from gateway.errors import DaemonError
from gateway.events import Event, PartFailed
from gateway.operator.operations.operation import Nothing
from gateway.operator.operator import Operator
from gateway.version import __version__
from kit.operations import SEVERAL, STATUS_AND_DEFECT, Told
from kit.process import PATIENCE

STATUS = b'{"verb": "status"}\n'
FINE = f'{{"version": "{__version__}", "ok": true, "status": "fine"}}\n'.encode()


class Open:
    """A control socket at `path`, with two verbs, and what it tells."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.events: list[Event] = []

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_unix_connection(str(self.path))

    async def asks(self, *lines: bytes) -> list[dict[str, Any]]:
        """The answers to these lines, over one connection."""
        reader, writer = await self.connect()
        writer.write(b"".join(lines))
        async with asyncio.timeout(PATIENCE):
            answers = [json.loads(await reader.readline()) for _ in lines]
        writer.close()
        assert {answer.pop("version") for answer in answers} == {__version__}
        return answers


def ask(path: Path) -> Told:
    """What a command hears at `path`."""
    with Conversation(Meant(path)) as conversation:
        return conversation.ask(STATUS_AND_DEFECT["status"], Nothing())


@asynccontextmanager
async def control(folder: Path) -> AsyncIterator[Open]:
    it = Open(folder / "control.sock")
    async with control_open(it.path, Operator(None, None), it.events.append, {**STATUS_AND_DEFECT, "several": SEVERAL}):
        yield it


async def test_many_requests_at_once_leave_others_their_turn(tmp_path: Path) -> None:
    turns = 0

    async def take_turns() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    async with control(tmp_path) as it:
        other = asyncio.create_task(take_turns())
        reader, writer = await it.connect()
        writer.write(STATUS * 2000)
        turns = 0
        await reader.readexactly(2000 * len(FINE))
        assert turns >= 2000
        other.cancel()
        writer.close()


async def test_json_that_is_nested_too_deep_gets_an_answer(tmp_path: Path) -> None:
    async with control(tmp_path) as it:
        answers = await it.asks(b"[" * 60_000 + b"\n", STATUS)
        assert answers == [{"ok": False, "error": "this is not JSON"}, {"ok": True, "status": "fine"}]
        assert it.events == []


async def test_a_defect_is_told_and_answered_and_the_connection_goes_on(tmp_path: Path) -> None:
    async with control(tmp_path) as it:
        answers = await it.asks(b'{"verb": "defect"}\n', STATUS)
        assert answers == [
            {"ok": False, "error": "a defect in the gateway; its log says more"},
            {"ok": True, "status": "fine"},
        ]
        (told,) = it.events
        assert isinstance(told, PartFailed)
        assert told.part == "control socket"
        assert "nobody foresaw this" in told.traceback


async def test_a_connection_that_is_held_at_the_end_is_closed_in_silence(tmp_path: Path) -> None:
    complaints: list[Any] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: complaints.append(context))
    async with control(tmp_path) as it:
        reader, writer = await it.connect()
        await it.asks(STATUS)
    async with asyncio.timeout(PATIENCE):
        assert await reader.read() == b""
    assert complaints == []
    writer.close()


async def test_one_client_too_many_hears_so_and_the_others_are_served(tmp_path: Path) -> None:
    assert MOST_CONNECTIONS == 16
    async with control(tmp_path) as it:
        crowd = [await it.connect() for _ in range(16)]
        refused = "the gateway says: 16 others are connected already; try again later"
        with pytest.raises(DaemonError, match=refused):
            await asyncio.to_thread(ask, it.path)
        for _, writer in crowd:
            writer.close()
        async with asyncio.timeout(PATIENCE):
            while len(asyncio.all_tasks()) > 1:  # noqa: ASYNC110 - a conversation that ends tells nobody
                await asyncio.sleep(0.002)
        assert await asyncio.to_thread(ask, it.path) == Told("fine")


async def test_several_answers_have_an_end_and_the_next_question_is_answered(tmp_path: Path) -> None:
    def hear(path: Path) -> list[Told]:
        with Conversation(Meant(path)) as conversation:
            begun_and_done = list(conversation.answers(SEVERAL, Nothing()))
            return [*begun_and_done, conversation.ask(STATUS_AND_DEFECT["status"], Nothing())]

    async with control(tmp_path) as it:
        assert await asyncio.to_thread(hear, it.path) == [Told("begun"), Told("done"), Told("fine")]


@contextmanager
def daemon(path: Path, answer: bytes, *, hears: bool = True) -> Iterator[Thread]:
    """Something at `path` that hangs up on who connects, without hearing all, or anything at all."""
    with ExitStack() as stack:
        door = stack.enter_context(socket(AF_UNIX))
        door.bind(str(path))
        door.listen()

        def hang_up() -> None:
            with door.accept()[0] as client:
                if hears:
                    client.recv(1)  # what is not read makes it a reset
                client.sendall(answer)

        thread = Thread(target=hang_up, name="daemon")
        thread.start()
        stack.callback(thread.join, PATIENCE)
        yield thread


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", r"the gateway closed the connection before it answered; is it stopping\?"),
        (b"HTTP/1.1 400\n", "what answers there is not modbus-gateway"),
        (b"[]\n", "what answers there is not modbus-gateway"),
    ],
)
def test_a_daemon_that_does_not_answer_is_a_problem_in_plain_words(tmp_path: Path, answer: bytes, words: str) -> None:
    path = tmp_path / "control.sock"
    with daemon(path, answer), pytest.raises(DaemonError, match=words):
        ask(path)


def test_why_a_daemon_hung_up_is_heard_by_who_has_not_asked_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, connected = tmp_path / "control.sock", daemon_module._connect
    with daemon(path, b'{"ok": false, "error": "later"}\n', hears=False) as thread:

        def slowly(gateway: Path) -> socket:
            sock = connected(gateway)
            thread.join(PATIENCE)
            return sock

        monkeypatch.setattr(daemon_module, "_connect", slowly)
        with pytest.raises(DaemonError, match="the gateway says: later"):
            ask(path)
