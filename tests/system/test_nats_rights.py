"""The configs that `fleet hub` writes, with a real server: who may say what to whom, by site."""

import asyncio
import base64
import json
import re
import socket
import ssl
from contextlib import AsyncExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pytest
from nats.aio.client import Client
from nats.aio.msg import Msg
from nats.errors import NoRespondersError
from nats.js.api import KeyValueConfig
from nats.js.errors import KeyWrongLastSequenceError, NoStreamResponseError

from gateway.fleet.bucket import LARGEST_VALUE
from gateway.fleet.credentials import public_key, sign
from gateway.fleet.hub.known import logins_in
from kit.hub import SITES, connect, key_in, write_hub
from kit.link import Link
from kit.nats import NatsServer, hub_and_leaf
from kit.pki import pki
from kit.process import PATIENCE

if TYPE_CHECKING:
    from kit.nats_tokens import Key

pytestmark = pytest.mark.needs("nats-server")

#: How long nothing must come, in seconds, where what must not come would come in a millisecond.
QUIET = 0.3


class Site:
    """A client of NATS, as the gateway of a site is one; `heard` is what came, `refused` what the server refused."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.heard: asyncio.Queue[Msg] = asyncio.Queue()
        self.refused: asyncio.Queue[str] = asyncio.Queue()
        self.client = Client()

    async def connect(self, port: int, folder: Path) -> None:
        """Log in with the credentials file of the site in this folder."""
        credentials = folder / "hub" / f"{self.name}.creds"
        inbox = f"_INBOX.{self.name}"
        await connect(self.client, port, credentials, error_cb=self._refuse, inbox_prefix=inbox)

    async def connect_by_token(self, port: int, token: str, key: "Key") -> None:
        await self.client.connect(
            f"nats://127.0.0.1:{port}",
            user_jwt_cb=token.encode,
            signature_cb=lambda nonce: base64.b64encode(key.sign(nonce.encode())),
            error_cb=self._refuse,
            inbox_prefix=f"_INBOX.{self.name}",
            allow_reconnect=False,
        )

    async def listen(self) -> None:
        """For requests, answers and heartbeats."""
        await self.hear(f"mbgw.{self.name}.unit.3.from.*", "mbgw")
        await self.hear(f"mbgw.{self.name}.answer.>")
        await self.hear("mbgw.*.clock")
        await self.client.flush()

    async def hear(self, subject: str, queue: str = "") -> None:
        await self.client.subscribe(subject, queue, cb=self.heard.put)

    async def ask(self, other: str, sender: str = "", reply: str = "") -> None:
        """Send a request to unit 3 of another site."""
        subject = f"mbgw.{other}.unit.3.from.{sender or self.name}"
        await self.client.publish(subject, b"\x03\x00\x00\x00\x01", reply or f"mbgw.{self.name}.answer.{other}.7")
        await self.client.flush()

    async def hears(self) -> Msg:
        return await asyncio.wait_for(self.heard.get(), PATIENCE)

    async def is_refused(self) -> str:
        return await asyncio.wait_for(self.refused.get(), PATIENCE)

    async def hears_nothing(self) -> bool:
        await asyncio.sleep(QUIET)
        return self.heard.empty()

    async def _refuse(self, error: Exception) -> None:
        await self.refused.put(str(error).lower())


class Fleet(NamedTuple):
    """The hub, the leaf node of plant-3 with a link between them, and a client for each site."""

    hub: NatsServer
    leaf: NatsServer
    link: Link
    control: Site
    plant1: Site
    plant3: Site


@pytest.fixture
async def fleet(tmp_path):
    with hub_and_leaf(tmp_path) as (hub, link, leaf):
        found = Fleet(hub, leaf, link, Site("control"), Site("plant-1"), Site("plant-3"))
        async with AsyncExitStack() as stack:
            for site, server in (found.control, hub), (found.plant1, hub), (found.plant3, leaf):
                await site.connect(server.port, tmp_path)
                stack.push_async_callback(site.client.close)
                await site.listen()
            yield found


async def asks_and_answers(asker: Site, other: Site) -> bytes:
    """What comes to `asker` when `other` answers it; between servers a subscription takes a moment to be known."""
    async with asyncio.timeout(PATIENCE):
        while True:
            await asker.ask(other.name)
            waiting = {asyncio.create_task(each.heard.get()) for each in (asker, other)}
            (done,), late = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            for each in late:
                each.cancel()
            first = done.result()
            if first.subject.startswith(f"mbgw.{asker.name}.answer."):
                assert first.headers["Status"] == "503"
                continue
            assert first.subject == f"mbgw.{other.name}.unit.3.from.{asker.name}"
            await other.client.publish(first.reply, b"\x03\x02\x12\x34")
            return (await asker.hears()).data


async def test_sites_ask_and_answer_one_another(fleet):
    control, plant1, plant3 = fleet.control, fleet.plant1, fleet.plant3
    pairs = (control, plant1), (plant1, control), (control, plant3), (plant3, control), (control, control)
    for asker, other in pairs:
        assert await asks_and_answers(asker, other) == b"\x03\x02\x12\x34"


async def test_a_site_asks_only_those_that_the_list_of_sites_names(tmp_path):
    sites = 'control = "control"\nsites = ["east", "north"]\n'
    config = (write_hub(tmp_path, sites).folder / "hub.conf").read_text()
    async with AsyncExitStack() as stack:
        hub = stack.enter_context(NatsServer(tmp_path, config=config))
        control, east, north = Site("control"), Site("east"), Site("north")
        for site in control, east, north:
            await site.connect(hub.port, tmp_path)
            stack.push_async_callback(site.client.close)
            await site.listen()
        for asked in east, north:
            assert await asks_and_answers(control, asked) == b"\x03\x02\x12\x34"
        for asker, asked in (east, north), (north, east), (east, control):
            await asker.ask(asked.name)
            assert (await asker.hears()).headers["Status"] == "503"
        hub.reload(write_hub(tmp_path, sites + 'asks = { east = ["north"] }').folder / "hub.conf")
        assert await asks_and_answers(east, north) == b"\x03\x02\x12\x34"
        await north.ask("east")
        assert (await north.hears()).headers["Status"] == "503"
        assert all(site.refused.empty() for site in (control, east, north))


async def test_at_a_reload_a_site_that_is_taken_out_is_disconnected_and_no_other(tmp_path):
    first = write_hub(tmp_path, 'control = "control"\nsites = ["east", "west"]')
    async with AsyncExitStack() as stack:
        hub = stack.enter_context(NatsServer(tmp_path, config=(first.folder / "hub.conf").read_text()))
        control, east, west = Site("control"), Site("east"), Site("west")
        for site in control, east, west:
            await site.connect(hub.port, tmp_path)
            stack.push_async_callback(site.client.close)
            await site.listen()
        await create(control, "mbgw-status")
        written = write_hub(tmp_path, 'control = "control"\nsites = ["east", "north"]')
        assert (written.new, written.removed, written.useless) == (("north",), ("west",), ("west.creds",))
        for _ in range(2):
            hub.reload(written.folder / "hub.conf")
        north = Site("north")
        await north.connect(hub.port, tmp_path)
        stack.push_async_callback(north.client.close)
        await north.listen()
        for asked in east, north:
            assert await asks_and_answers(control, asked) == b"\x03\x02\x12\x34"
            await (await buckets(asked, "mbgw-status")).put(asked.name, b"up")
        await west.is_refused()
        assert [site.client.is_connected for site in (control, east, north, west)] == [True, True, True, False]
        with socket.create_connection(("127.0.0.1", hub.port), timeout=PATIENCE) as plain:
            log_in(plain, "west", tmp_path)
            with plain.makefile("rb") as lines:
                assert b"Authorization Violation" in lines.read()


@pytest.mark.parametrize("asker", ["plant1", "plant3"])
async def test_it_says_at_once_that_nobody_is_there(fleet, asker):
    site = getattr(fleet, asker)
    await site.ask("plant-9")
    assert (await site.hears()).headers["Status"] == "503"


@pytest.mark.parametrize("server", ["hub", "leaf"])
async def test_a_message_of_more_than_64_kib_ends_the_connection_of_its_sender_and_no_other(fleet, server, tmp_path):
    site, node = (fleet.plant1, fleet.hub) if server == "hub" else (fleet.plant3, fleet.leaf)
    assert site.client.max_payload == LARGEST_VALUE
    said = await asyncio.to_thread(publish_beyond, node.port, site.name, tmp_path, LARGEST_VALUE + 1)
    assert b"Maximum Payload" in said
    assert await asks_and_answers(site, fleet.control) == b"\x03\x02\x12\x34"


def log_in(plain: socket.socket, site: str, folder: Path) -> None:
    """Log in as a site, in the text of the protocol."""
    told = json.loads(plain.recv(65536).split(b" ", 1)[1])
    key = key_in(folder / "hub" / f"{site}.creds")
    hello = {"nkey": public_key(key), "sig": sign(key, told["nonce"]).decode(), "verbose": False}
    plain.sendall(f"CONNECT {json.dumps(hello)}\r\n".encode())


def publish_beyond(port: int, site: str, folder: Path, size: int) -> bytes:
    """Send a message of so many bytes; all that the server says until it ends the connection."""
    said = b""
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as plain:
        log_in(plain, site, folder)
        plain.sendall(f"PUB mbgw.{site}.clock {size}\r\n".encode())
        with suppress(ConnectionError):
            while data := plain.recv(4096):
                said += data
    return said


async def test_a_site_may_not_ask_by_another_name(fleet):
    await fleet.plant1.ask("control", sender="plant-3")
    assert "publish" in await fleet.plant1.is_refused()
    assert await fleet.control.hears_nothing()


async def test_a_site_with_a_leaf_node_may_not_ask_by_another_name(fleet):
    await asks_and_answers(fleet.plant3, fleet.control)
    await fleet.plant3.ask("control", sender="plant-1")
    assert "publish" in await fleet.plant3.is_refused()
    assert await fleet.control.hears_nothing()


async def test_a_leaf_node_that_permits_everything_is_no_other_site_either(fleet, tmp_path):
    await asks_and_answers(fleet.plant3, fleet.control)
    password = logins_in((tmp_path / "hub" / "hub.conf").read_text())["plant-3"].password
    with LeafProtocol(fleet.hub.leaf_port, "plant-3", password) as forger:
        forger.publish("mbgw.control.unit.3.from.plant-1", "mbgw")
        forger.publish("mbgw.control.unit.3.from.plant-3", "mbgw")
        forger.publish("mbgw.control.answer.plant-1.7")
        forger.publish("mbgw.plant-1.clock")
        forger.publish("$KV.mbgw-status.plant-1")
        forger.publish("mbgw.control.answer.plant-3.8")
        forger.wait()
    assert (await fleet.control.hears()).subject == "mbgw.control.unit.3.from.plant-3"
    assert (await fleet.control.hears()).subject == "mbgw.control.answer.plant-3.8"
    assert await fleet.control.hears_nothing()


class LeafProtocol:
    """A leaf node that keeps to none of the rights that the hub tells it."""

    def __init__(self, port: int, user: str, password: str) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self._lines = self._socket.makefile("rb")
        hello = {"user": user, "pass": password, "name": "forger", "server_id": "FORGER", "headers": True}
        self._socket.sendall(f"CONNECT {json.dumps(hello)}\r\n".encode())
        self.wait()

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        self._lines.close()
        self._socket.close()

    def publish(self, subject: str, queue: str = "") -> None:
        to = f"{subject} | {queue}" if queue else subject
        self._socket.sendall(f"LMSG {to} 2\r\nhi\r\n".encode())

    def wait(self) -> None:
        """Until the hub has read what was sent."""
        self._socket.sendall(b"PING\r\n")
        while (line := self._lines.readline()) != b"PONG\r\n":
            assert line, "the hub has closed the connection"


@pytest.mark.parametrize("listener", ["plant1", "plant3"])
async def test_a_site_hears_only_what_is_its_own(fleet, listener):
    site = getattr(fleet, listener)
    for subject in "mbgw.control.unit.*.from.*", "mbgw.control.answer.>", "_INBOX.control.>", "mbgw.>", "_INBOX.>", ">":
        await site.hear(subject)
        await site.client.flush()
        assert "subscription" in await site.is_refused()


async def test_a_site_may_not_answer_for_another(fleet):
    await fleet.plant1.client.publish("mbgw.control.answer.plant-3.7", b"\x03\x02\x00\x00")
    assert "publish" in await fleet.plant1.is_refused()
    assert await fleet.control.hears_nothing()


async def test_heartbeats_are_heard_by_those_who_ask_and_not_forged(fleet):
    await fleet.plant1.client.publish("mbgw.plant-3.clock", b"1")
    assert "publish" in await fleet.plant1.is_refused()
    await asks_and_answers(fleet.control, fleet.plant3)
    await fleet.control.client.publish("mbgw.control.clock", b"2")
    assert (await fleet.plant3.hears()).data == b"2"
    await fleet.plant3.client.publish("mbgw.plant-3.clock", b"3")
    assert {(await fleet.control.hears()).data, (await fleet.control.hears()).data} == {b"2", b"3"}


async def buckets(site: Site, name: str):
    return await site.client.jetstream(timeout=PATIENCE).key_value(name)


async def create(site: Site, name: str):
    return await site.client.jetstream(timeout=PATIENCE).create_key_value(KeyValueConfig(bucket=name, history=1))


async def test_the_first_gateway_makes_the_buckets_and_no_other_may(fleet):
    await create(fleet.control, "mbgw-status")
    await create(fleet.control, "mbgw-lease")
    with pytest.raises(TimeoutError):
        await fleet.plant1.client.jetstream(timeout=QUIET).create_key_value(KeyValueConfig(bucket="mbgw-status"))
    assert "$js.api.stream.create" in await fleet.plant1.is_refused()


async def test_each_site_writes_its_own_status_and_reads_all_wherever_it_is(fleet):
    await create(fleet.control, "mbgw-status")
    stores = {site: await buckets(site, "mbgw-status") for site in (fleet.control, fleet.plant1, fleet.plant3)}
    for site, store in stores.items():
        await store.put(site.name, site.name.encode())
    for store in stores.values():
        assert [(await store.get(site.name)).value.decode() for site in stores] == ["control", "plant-1", "plant-3"]


@pytest.mark.parametrize(("forger", "other"), [("plant1", "control"), ("plant3", "control"), ("control", "plant-1")])
async def test_a_site_may_not_write_the_status_of_another(fleet, forger, other):
    await create(fleet.control, "mbgw-status")
    site = getattr(fleet, forger)
    store = await buckets(site, "mbgw-status")
    with pytest.raises((TimeoutError, NoStreamResponseError)):
        await asyncio.wait_for(store.put(other, b"gone"), 1.0)
    assert "publish" in await site.is_refused()


@pytest.mark.parametrize("holder", ["plant1", "plant3"])
async def test_a_site_takes_its_own_leases_only(fleet, holder):
    site = getattr(fleet, holder)
    await create(fleet.control if site is fleet.plant1 else site, "mbgw-lease")
    store = await buckets(site, "mbgw-lease")
    revision = await store.create(f"{site.name}.hall-a", b"{}")
    await store.update(f"{site.name}.hall-a", b"{}", revision)
    with pytest.raises(KeyWrongLastSequenceError):
        await store.update(f"{site.name}.hall-a", b"{}", revision)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(store.put("control.hall-a", b"{}"), QUIET)
    assert "publish" in await site.is_refused()


async def test_without_the_way_to_the_hub_a_site_has_its_leases_and_itself(fleet):
    await create(fleet.control, "mbgw-status")
    store = await create(fleet.plant3, "mbgw-lease")
    await asks_and_answers(fleet.plant3, fleet.control)
    fleet.link.cut()
    fleet.leaf.wait_for_leaves(0)
    assert await store.put("plant-3.hall-a", b"{}")
    assert await asks_and_answers(fleet.plant3, fleet.plant3)
    await fleet.plant3.ask("control")
    assert (await fleet.plant3.hears()).headers["Status"] == "503"
    with pytest.raises(NoRespondersError):
        await fleet.plant3.client.request("$JS.API.STREAM.INFO.KV_mbgw-status", timeout=PATIENCE)
    fleet.link.mend()
    assert await asks_and_answers(fleet.plant3, fleet.control)
    assert await asks_and_answers(fleet.control, fleet.plant3)


@pytest.mark.parametrize(("forger", "other"), [("plant1", "control"), ("control", "plant1")])
async def test_what_the_server_answers_a_site_goes_to_no_other_and_changes_no_other_key(fleet, forger, other):
    """The server looks at no reply subject, so in an account of all sites it would: hence an account for each."""
    forger, other = getattr(fleet, forger), getattr(fleet, other)
    keys = ("mbgw-lease", f"{other.name}.hall-a"), ("mbgw-status", other.name)
    for name, key in keys:
        await create(fleet.control, name)
        await (await buckets(other, name)).create(key, b"mine")
    for reply in (
        f"mbgw.{other.name}.unit.3.from.plant-3",
        f"mbgw.{other.name}.answer.plant-3.7",
        "mbgw.plant-3.clock",
        *(f"$KV.{name}.{key}" for name, key in keys),
        "$JS.API.STREAM.PURGE.KV_mbgw-lease",
        "$JS.API.STREAM.PURGE.KV_mbgw-status",
    ):
        for subject, body in (
            (f"$KV.mbgw-lease.{forger.name}.hall-a", b"x"),
            (f"$KV.mbgw-status.{forger.name}", b"x"),
            ("$JS.API.STREAM.INFO.KV_mbgw-status", b""),
            ("$JS.API.STREAM.MSG.GET.KV_mbgw-status", f'{{"last_by_subj": "$KV.mbgw-status.{forger.name}"}}'.encode()),
        ):
            await forger.client.publish(subject, body, reply=reply)
    assert await other.hears_nothing()
    for name, key in keys:
        assert (await (await buckets(forger, name)).get(key)).value == b"mine"
    own = await buckets(forger, "mbgw-lease")
    assert (await own.get(f"{forger.name}.hall-a")).value == b"x", "the server has taken none of it"


@pytest.mark.parametrize("holder", ["plant1", "plant3"])
async def test_a_site_writes_no_more_keys_than_the_leases_that_are_named(fleet, holder):
    """Else it could fill the store, and nobody could renew a lease."""
    site = getattr(fleet, holder)
    await create(fleet.control if site is fleet.plant1 else site, "mbgw-lease")
    await site.client.publish(f"$KV.mbgw-lease.{site.name}.another", b"x")
    assert "publish" in await site.is_refused()


async def test_a_site_reads_no_bucket_by_direct_get(fleet):
    """By which the server publishes what the site has stored, as it is, to any subject."""
    for site in fleet.control, fleet.plant1, fleet.plant3:
        await site.client.publish("$JS.API.DIRECT.GET.KV_mbgw-status.$KV.mbgw-status.plant-1", b"")
        assert "publish" in await site.is_refused()


def test_a_connection_has_a_bound_of_subscriptions(tmp_path):
    with (
        NatsServer(tmp_path, config=(write_hub(tmp_path).folder / "hub.conf").read_text()) as hub,
        socket.create_connection(("127.0.0.1", hub.port), timeout=PATIENCE) as plain,
        plain.makefile("rb") as lines,
    ):
        log_in(plain, "plant-1", tmp_path)
        subscriptions = b"".join(b"SUB mbgw.*.clock %d\r\n" % number for number in range(2001))
        plain.sendall(subscriptions + b"PING\r\n")
        assert any(b"maximum subscriptions exceeded" in line for line in iter(lines.readline, b"PONG\r\n"))


def test_a_connection_that_does_not_read_takes_little_memory(tmp_path):
    with NatsServer(tmp_path, config=(write_hub(tmp_path).folder / "hub.conf").read_text()) as hub:
        assert hub.told("varz")["max_pending"] == 8 * 1024 * 1024


async def test_a_site_does_not_take_the_connections_of_others(fleet, tmp_path):
    async with AsyncExitStack() as stack:
        for _ in range(19):
            site = Site("plant-1")
            await site.connect(fleet.hub.port, tmp_path)
            stack.push_async_callback(site.client.close)
        with socket.create_connection(("127.0.0.1", fleet.hub.port), timeout=PATIENCE) as plain:
            log_in(plain, "plant-1", tmp_path)
            with plain.makefile("rb") as lines:
                assert b"maximum account active connections exceeded" in lines.read()
        another = Site("control")
        await another.connect(fleet.hub.port, tmp_path)
        await another.client.close()


async def test_nobody_gets_in_without_a_key(fleet, tmp_path):
    password = logins_in((tmp_path / "hub" / "hub.conf").read_text())["plant-3"].password
    key = public_key(key_in(tmp_path / "hub" / "control.creds"))
    for server in fleet.hub, fleet.leaf:
        for login in {}, {"user": "plant-3", "pass": password}, {"nkey": key, "sig": "AAAA"}:
            with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE) as plain:
                plain.sendall(f"CONNECT {json.dumps(login)}\r\n".encode())
                with plain.makefile("rb") as lines:
                    assert b"Authorization Violation" in lines.read()


async def test_with_a_certificate_nothing_is_said_in_the_clear(tmp_path):
    files = {
        key: pki() / name for key, name in (("certificate", "server.crt"), ("key", "server.key"), ("ca", "ca.crt"))
    }
    made = write_hub(tmp_path, SITES + "".join(f'{key} = "{file}"\n' for key, file in files.items())).folder
    hub, leaf = ((made / name).read_text() for name in ("hub.conf", "plant-3.leaf.conf"))
    hub = hub.replace("0.0.0.0", "127.0.0.1")
    with NatsServer(tmp_path, config=hub) as server, NatsServer(tmp_path, config=leaf, leaf_of=server) as node:
        node.wait_for_leaves()
        client = Client()
        await connect(client, server.port, made / "control.creds", tls=ssl.create_default_context(cafile=files["ca"]))
        await client.close()
        with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE) as plain:
            assert json.loads(plain.recv(65536).split(b" ", 1)[1])["tls_required"] is True


def rights(site: str, folder: Path) -> tuple[list[str], list[str]]:
    """What a site of a fleet without leaf nodes may publish and hear at the hub, by its own name for it."""
    told = (write_hub(folder, f'control = "x"\nsites = ["{site}"]').folder / "hub.conf").read_text()
    publish, _, subscribe = told.partition(f'\n  "{site}": {{')[2].partition("subscribe:")
    return re.findall(r'"([^"]+)"', publish), re.findall(r'"([^"]+)"', subscribe.partition("]")[0])


async def test_one_template_gives_each_site_with_credentials_only_its_own_rights(tmp_path):
    """For fleets whose sites are not in the server's config: what their tokens may do follows from the name there."""
    operators = pytest.importorskip("kit.nats_tokens", reason="it needs cryptography")
    publish, subscribe = (
        [right.replace("control", "{{name()}}") for right in some] for some in rights("control", tmp_path)
    )
    operator = operators.Operator(publish, subscribe)
    with NatsServer(tmp_path, operator.settings) as server:
        north, south = Site("north"), Site("south")
        for site in north, south:
            await site.connect_by_token(server.port, *operator.user(site.name))
            await site.listen()
        assert await asks_and_answers(north, south) == b"\x03\x02\x12\x34"
        assert north.refused.empty()
        for subject in (
            "mbgw.south.unit.3.from.east",
            "mbgw.east.answer.south.7",
            "mbgw.south.clock",
            "$KV.mbgw-status.south",
        ):
            await north.client.publish(subject, b"")
            assert "publish" in await north.is_refused()
        await north.hear("mbgw.south.answer.>")
        await north.client.flush()
        assert "subscription" in await north.is_refused()
        for site in north, south:
            await site.client.close()
