"""The connection to a real NATS server: logins, buckets, what is refused, and what is lost."""

import asyncio
import socket
import ssl
import sys
from contextlib import asynccontextmanager
from typing import Any

import pytest
from nats.js.api import KeyValueConfig

from gateway.errors import FleetError
from gateway.fleet.connection import PING_INTERVAL, NatsConnection
from gateway.fleet.counts import LostMessages
from gateway.fleet.credentials import make_credentials, public_key, read_credentials
from gateway.fleet.messages import Message
from gateway.fleet.settings import Login, Server
from kit.free_port import free_port
from kit.nats import NatsServer
from kit.process import PATIENCE

pytestmark = pytest.mark.needs("nats-server")


def server_of(nats: NatsServer, *, is_encrypted: bool = False) -> Server:
    return Server("127.0.0.1", nats.port, is_encrypted)


async def subscribed(nats: NatsServer, connection: NatsConnection, subject: str, *how: Any) -> None:
    """Subscribe, and wait until the server has taken it: what others send from now on is delivered."""
    await connection.subscribe(subject, *how)

    def is_taken() -> bool:
        return any(each["subject"] == subject for each in nats.told("subsz?subs=1").get("subscriptions_list", ()))

    await asyncio.to_thread(nats.wait_until, is_taken, "subscribed")


async def test_a_message_that_nobody_wants_says_so(tmp_path):
    with NatsServer(tmp_path) as nats:
        connection = NatsConnection(server_of(nats), Login("a"))
        await connection.open()
        heard: asyncio.Queue[Message] = asyncio.Queue()
        await connection.subscribe("mbgw.a.answer.>", heard.put_nowait)
        connection.publish(Message("mbgw.b.unit.1.from.a", b"\x03", "mbgw.a.answer.b.1", {"Hops": "1"}))
        answer = await asyncio.wait_for(heard.get(), PATIENCE)
        assert (answer.subject, answer.has_no_responders) == ("mbgw.a.answer.b.1", True)
        await connection.close()


async def test_what_is_subscribed_comes_with_its_headers_until_it_is_ended(tmp_path):
    with NatsServer(tmp_path) as nats:
        connection = NatsConnection(server_of(nats), Login("a"))
        await connection.open()
        heard: asyncio.Queue[Message] = asyncio.Queue()
        end = await connection.subscribe("mbgw.a.unit.1.from.*", heard.put_nowait, "mbgw")
        message = Message("mbgw.a.unit.1.from.b", b"\x03\x00", "mbgw.b.answer.a.1", {"Client": "x:1"})
        connection.publish(message)
        found = await asyncio.wait_for(heard.get(), PATIENCE)
        assert (found.subject, found.body, found.reply) == (message.subject, message.body, message.reply)
        assert dict(found.headers or {}) == {"Client": "x:1"}
        await end()
        answers: asyncio.Queue[Message] = asyncio.Queue()
        await connection.subscribe("mbgw.b.answer.>", answers.put_nowait)
        connection.publish(message)
        assert (await asyncio.wait_for(answers.get(), PATIENCE)).has_no_responders
        assert heard.empty()
        await connection.close()


#: What a tool such as `nats kv del mbgw-status a` sends.
DELETE_A = b"HPUB $KV.mbgw-status.a 31 31\r\nNATS/1.0\r\nKV-Operation: DEL\r\n\r\n\r\n"


async def test_a_bucket_changes_only_for_who_knows_what_is_there(tmp_path):
    with NatsServer(tmp_path) as nats:
        connection = NatsConnection(server_of(nats), Login("a"))
        await connection.open()
        bucket = await connection.bucket("mbgw-status")
        assert await bucket.entries() == []
        assert await bucket.get("a") is None
        first = await bucket.create("a", b"1")
        assert await bucket.create("a", b"2") is None
        assert await bucket.update("a", b"3", first)
        assert await bucket.update("a", b"4", first) is None
        assert (await bucket.get("a")).value == b"3"
        await bucket.put("b", b"5")
        assert {each.key: each.value for each in await bucket.entries()} == {"a": b"3", "b": b"5"}
        assert all(each.created for each in await bucket.entries())
        await asyncio.to_thread(publish_raw, nats, DELETE_A)
        assert await bucket.get("a") is None
        assert [each.key for each in await bucket.entries()] == ["b"]
        assert await bucket.create("a", b"6")
        await connection.close()


async def test_a_flood_leaves_turns_to_other_work_and_what_it_loses_is_counted(tmp_path):
    with NatsServer(tmp_path) as nats:
        messages = LostMessages()
        connection = NatsConnection(server_of(nats), Login("a"), messages=messages)
        await connection.open()
        heard, longest, turns = 0, 0, 0
        at_last_turn = 0

        def take(message: Message) -> None:
            nonlocal heard
            heard += 1

        async def watch() -> None:
            nonlocal at_last_turn, longest, turns
            while True:
                await asyncio.sleep(0)
                longest, turns = max(longest, heard - at_last_turn), turns + 1
                at_last_turn = heard

        await subscribed(nats, connection, "unit.1", take, "mbgw", 4096)
        watching = asyncio.create_task(watch())
        await asyncio.to_thread(publish_raw, nats, raw_message(b"unit.1", b"answer") * 3000)
        async with asyncio.timeout(PATIENCE):
            while heard + messages.overflowed < 3000:  # noqa: ASYNC110 - counted by the library
                await asyncio.sleep(0.01)
        assert turns > 100
        assert longest <= 16
        watching.cancel()
        await connection.close()


async def test_messages_that_overflow_their_queue_are_counted(tmp_path):
    with NatsServer(tmp_path) as nats:
        messages = LostMessages()
        connection = NatsConnection(server_of(nats), Login("a"), messages=messages)
        await connection.open()
        heard: list[Message] = []
        await subscribed(nats, connection, "unit.1", heard.append, "mbgw", 4)
        await asyncio.to_thread(publish_raw, nats, raw_message(b"unit.1", b"answer") * 1000)
        async with asyncio.timeout(PATIENCE):
            while len(heard) + messages.overflowed < 1000:  # noqa: ASYNC110 - as above
                await asyncio.sleep(0.01)
        assert messages.overflowed > 0
        assert not connection.lost.done()
        await connection.close()


def delete_bucket(nats: NatsServer, name: str) -> None:
    publish_raw(nats, b"PUB $JS.API.STREAM.DELETE.KV_%b 0\r\n\r\n" % name.encode())
    nats.wait_until(lambda: nats.told("jsz").get("streams", 0) == 0, "deleted")


@pytest.mark.parametrize(
    "call",
    [
        lambda bucket: bucket.get("a"),
        lambda bucket: bucket.create("b", b"2"),
        lambda bucket: bucket.update("a", b"2", 1),
        lambda bucket: bucket.put("a", b"2"),
        lambda bucket: bucket.entries(),
    ],
    ids=["get", "create", "update", "put", "entries"],
)
async def test_a_bucket_that_was_deleted_is_made_again_by_who_asks_for_it_next(tmp_path, call):
    with NatsServer(tmp_path) as nats:
        connection = NatsConnection(server_of(nats), Login("a"))
        await connection.open()
        bucket = await connection.bucket("mbgw-lease")
        await bucket.put("a", b"1")
        await asyncio.to_thread(delete_bucket, nats, "mbgw-lease")
        with pytest.raises(FleetError, match="the bucket mbgw-lease was deleted"):
            await call(bucket)
        again = await connection.bucket("mbgw-lease")
        assert await again.get("a") is None
        await again.put("a", b"2")
        await connection.close()


async def test_who_makes_the_bucket_of_statuses_makes_that_of_leases_too(tmp_path):
    """A site with a lease may make none, and the one that may has perhaps no lease."""
    with NatsServer(tmp_path) as nats:
        connection = NatsConnection(server_of(nats), Login("control"))
        await connection.open()
        await connection.bucket("mbgw-status")
        assert nats.told("jsz")["streams"] == 2
        await connection.close()


async def _opened(nats: NatsServer, login: Login, *, is_encrypted: bool = False) -> None:
    connection = NatsConnection(server_of(nats, is_encrypted=is_encrypted), login)
    try:
        await connection.open()
    finally:
        await connection.close()


async def test_a_wrong_login_is_told_in_words(tmp_path):
    with NatsServer(tmp_path, "authorization { user: a, password: right }") as nats:
        await _opened(nats, Login("a", "a", "right"))
        with pytest.raises(FleetError, match="it refuses this user"):
            await _opened(nats, Login("a", "a", "wrong"))


async def test_a_credentials_file_logs_in(tmp_path):
    operators = pytest.importorskip("kit.nats_tokens", reason="it needs cryptography")
    operator = operators.Operator(["mbgw.>"], ["mbgw.>"])
    with NatsServer(tmp_path, operator.settings) as nats:
        await _opened(nats, Login("a", credentials=operator.credentials("a")))
        other = operators.Operator(["mbgw.>"], ["mbgw.>"])
        with pytest.raises(FleetError, match="it refuses this user"):
            await _opened(nats, Login("a", credentials=other.credentials("a")))
        with pytest.raises(FleetError, match="it is not a credentials file"):
            await _opened(nats, Login("a", credentials="-----BEGIN NATS USER JWT-----\nx\n"))


async def test_a_credentials_file_with_a_key_alone_logs_in_where_the_server_knows_the_key(tmp_path):
    text, other = make_credentials("a"), make_credentials("a")
    known = public_key(read_credentials(text).key)
    with NatsServer(tmp_path, f"authorization {{ users: [{{ nkey: {known} }}] }}") as nats:
        await _opened(nats, Login("a", credentials=text))
        with pytest.raises(FleetError, match="it refuses this user"):
            await _opened(nats, Login("a", credentials=other))
        context = ssl.create_default_context()
        with pytest.raises(FleetError, match="it does not offer TLS"):
            await _opened(nats, Login("a", credentials=text, context=context), is_encrypted=True)


async def test_without_pynacl_a_credentials_file_says_what_to_install(tmp_path, monkeypatch):
    operators = pytest.importorskip("kit.nats_tokens", reason="it needs cryptography")
    operator = operators.Operator(["mbgw.>"], ["mbgw.>"])
    monkeypatch.setitem(sys.modules, "nacl", None)
    monkeypatch.setitem(sys.modules, "nacl.signing", None)
    with (
        NatsServer(tmp_path, operator.settings) as nats,
        pytest.raises(FleetError, match="apt install python3-nacl"),
    ):
        await _opened(nats, Login("a", credentials=operator.credentials("a")))


async def test_no_password_goes_where_tls_was_asked_for_and_is_not_offered(tmp_path):
    with NatsServer(tmp_path, "authorization { user: a, password: right }") as nats:
        context = ssl.create_default_context()
        with pytest.raises(FleetError, match="it does not offer TLS"):
            await _opened(nats, Login("a", "a", "right", context=context), is_encrypted=True)


async def test_nobody_at_the_address_is_told_in_words():
    connection = NatsConnection(Server("127.0.0.1", free_port()), Login("a"))
    with pytest.raises(FleetError, match="Connection refused"):
        await connection.open()
    await connection.close()


async def test_a_connection_that_is_lost_says_so_and_takes_nothing_more(tmp_path):
    with NatsServer(tmp_path) as nats:
        connection = NatsConnection(server_of(nats), Login("a"))
        await connection.open()
        nats.kill()
        assert await asyncio.wait_for(asyncio.shield(connection.lost), PATIENCE)
        assert not connection.publish(Message("mbgw.a.clock", b"1"))
        await connection.close()


async def test_a_subject_that_is_refused_is_told(tmp_path):
    rights = '{ publish: ["mbgw.a.clock"], subscribe: ["mbgw.a.>"] }'
    with NatsServer(
        tmp_path, f"authorization {{ users: [{{ user: a, password: a, permissions: {rights} }}] }}"
    ) as nats:
        refused: asyncio.Queue[str] = asyncio.Queue()
        connection = NatsConnection(server_of(nats), Login("a", "a", "a"), refused.put_nowait)
        await connection.open()
        connection.publish(Message("mbgw.b.unit.1.from.c", b"\x03"))
        assert "mbgw.b.unit.1.from.c" in await asyncio.wait_for(refused.get(), PATIENCE)
        await connection.close()


def publish_raw(nats: NatsServer, command: bytes) -> None:
    """Send what no library would send, and wait until the server has taken it."""
    with socket.create_connection(("127.0.0.1", nats.port), PATIENCE) as plain:
        lines = plain.makefile("rb")
        lines.readline()
        plain.sendall(b'CONNECT {"verbose":false,"headers":true,"no_responders":true}\r\n' + command + b"PING\r\n")
        while (said := lines.readline()) == b"PING\r\n":  # which the server asks after two seconds
            pass
        assert said == b"PONG\r\n"
        lines.close()


def raw_message(subject: bytes, reply: bytes, headers: bytes = b"") -> bytes:
    if not headers:
        return b"PUB %b %b 1\r\n\x03\r\n" % (subject, reply)
    return b"HPUB %b %b %d %d\r\n%b\x03\r\n" % (subject, reply, len(headers), len(headers) + 1, headers)


@pytest.mark.parametrize(
    ("subject", "reply", "headers"),
    [
        (b"unit.\xff", b"answer", b""),
        (b"unit.1", b"answer.\xff", b""),
        (b"unit.1", b"answer", b"NA"),
        (b"unit.1", b"answer", b"NATS/1.0"),
        (b"unit.1", b"answer", b"NATS/1.0 \xff\xff\xff\r\n\r\n"),
        (b"unit.1", b"answer", b"NATS/1.0 100 \xff\xff\xff\r\n\r\n"),
        (b"unit.1", b"answer", b"NATS/1.0\r\n" + b"a:\r\n" * 2000 + b"\r\n"),
    ],
    ids=["subject", "reply", "no first line", "no end of it", "status", "description", "too long"],
)
async def test_a_message_that_cannot_be_read_is_dropped_and_no_other(tmp_path, subject, reply, headers):
    with NatsServer(tmp_path) as nats:
        messages = LostMessages()
        connection = NatsConnection(server_of(nats), Login("a"), messages=messages)
        await connection.open()
        heard: asyncio.Queue[Message] = asyncio.Queue()
        await subscribed(nats, connection, "unit.*", heard.put_nowait)
        command = raw_message(subject, reply, headers) + raw_message(b"unit.2", b"answer")
        await asyncio.to_thread(publish_raw, nats, command)
        assert (await asyncio.wait_for(heard.get(), PATIENCE)).subject == "unit.2"
        assert messages.unreadable == 1
        assert not connection.lost.done()
        await connection.close()


@asynccontextmanager
async def server_that_says(line: bytes):
    """A server that logs everybody in, and then says this."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b'INFO {"server_id":"x","version":"2.9.10","headers":true,"max_payload":65536}\r\n')
        while await reader.readline() != b"PING\r\n":
            pass
        writer.write(b"PONG\r\n" + line)
        await reader.read()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    async with server:
        yield Server("127.0.0.1", server.sockets[0].getsockname()[1])


async def test_a_connection_that_is_not_read_any_more_is_lost_at_once():
    async with server_that_says(b"INFO {]\r\n") as server:
        connection = NatsConnection(server, Login("a"))
        await connection.open()
        async with asyncio.timeout(PING_INTERVAL):
            assert await connection.lost == "it cannot be read any more"
        await connection.close()


async def test_in_a_bucket_of_a_gateway_nothing_can_be_emptied(tmp_path):
    """Who may write one key could empty it by a header, or have the server's own answer come as a request to purge."""
    with NatsServer(tmp_path) as nats:
        warned: list[str] = []
        connection = NatsConnection(server_of(nats), Login("a"), warn=warned.append)
        await connection.open()
        bucket = await connection.bucket("mbgw-lease")
        await bucket.create("b.hall", b"held")
        roll_up = b"NATS/1.0\r\nNats-Rollup: all\r\n\r\n"
        await asyncio.to_thread(
            publish_raw, nats, b"HPUB $KV.mbgw-lease.a %d %d\r\n%b\r\n" % (*2 * (len(roll_up),), roll_up)
        )
        purge = b"$JS.API.STREAM.PURGE.KV_mbgw-lease"
        await asyncio.to_thread(publish_raw, nats, b"PUB $KV.mbgw-lease.a %b 1\r\nx\r\n" % purge)
        await asyncio.to_thread(publish_raw, nats, b"PUB $JS.API.INFO %b 0\r\n\r\n" % purge)
        await bucket.put("a", b"last")
        assert {each.key: each.value for each in await bucket.entries()} == {"a": b"last", "b.hall": b"held"}
        assert warned == []
        await connection.close()


async def test_a_bucket_that_lets_sites_empty_it_is_used_with_a_warning(tmp_path):
    """So do the library and `nats kv add` make them."""
    with NatsServer(tmp_path) as nats:
        warned: list[str] = []
        connection = NatsConnection(server_of(nats), Login("a"), warn=warned.append)
        await connection.open()
        await connection._client.jetstream().create_key_value(KeyValueConfig("mbgw-lease", direct=True, ttl=60.0))
        bucket = await connection.bucket("mbgw-lease")
        assert await bucket.create("a.hall", b"held")
        assert (await bucket.get("a.hall")).value == b"held"
        [warning] = warned
        assert warning.startswith(
            "the bucket mbgw-lease lets each site empty it by a roll-up and can be emptied by an "
        )
        assert " forgets entries with time: delete it, " in warning
        await connection.close()
