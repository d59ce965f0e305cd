"""The nats-server of the tests, and the link to it: what tests of fleets rely on."""

import json
import select
import socket

import pytest

from kit.link import Link
from kit.nats import NatsServer
from kit.process import PATIENCE

pytestmark = pytest.mark.needs("nats-server")


class Plain:
    """A connection in the text of the NATS protocol; its deadline is that of its socket."""

    def __init__(self, port: int, **options: object) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self.lines = self._socket.makefile("rb")
        self.info = json.loads(self.lines.readline().removeprefix(b"INFO "))
        self.send(f"CONNECT {json.dumps({'verbose': False, **options})}", "PING")

    def send(self, *lines: str) -> None:
        self._socket.sendall("".join(f"{line}\r\n" for line in lines).encode())

    def hears(self) -> str:
        """The next line that is not the server's own PING, whose first one comes after two seconds."""
        while (line := self.lines.readline()) == b"PING\r\n":
            pass
        return line.decode().rstrip()

    def is_answered_within(self, seconds: float) -> bool:
        self.send("PING")
        return bool(select.select([self._socket], [], [], seconds)[0])

    def close(self) -> None:
        self.lines.close()
        self._socket.close()


@pytest.fixture
def server(tmp_path):
    with NatsServer(tmp_path) as found:
        yield found


def test_it_has_jetstream_and_is_itself_again_after_a_kill(server):
    first = Plain(server.port)
    assert first.info["jetstream"] is True
    assert first.hears() == "PONG"
    server.restart()
    assert first.hears() == ""
    second = Plain(server.port)
    assert second.info["server_name"] == first.info["server_name"]
    assert second.info["server_id"] != first.info["server_id"]
    first.close()
    second.close()


def test_halted_it_keeps_its_connections_and_says_nothing(server):
    client = Plain(server.port)
    assert client.hears() == "PONG"
    server.halt()
    assert not client.is_answered_within(0.2)
    server.resume()
    assert client.hears() == "PONG"
    client.close()


def test_a_stop_ends_it_though_it_is_halted(server):
    server.halt()
    server.stop()
    with pytest.raises(ConnectionRefusedError):
        Plain(server.port)


def test_a_leaf_node_passes_messages_to_its_hub(tmp_path):
    users = "authorization { users: [{ user: a, password: b }, { user: c, password: d }] }"
    with (
        NatsServer(tmp_path, users) as hub,
        NatsServer(tmp_path, domain="hall-a", leaf_of=hub, user="c:d") as leaf,
    ):
        hub.wait_for_leaves()
        leaf.wait_for_leaves()
        there = Plain(hub.port, user="a", **{"pass": "b"})
        there.send("SUB greeting 1", "PING")
        assert [there.hears(), there.hears()] == ["PONG", "PONG"]
        here = Plain(leaf.port)
        leaf.wait_until(lambda: "greeting" in str(leaf.told("leafz?subs=1")), "asked for greetings")
        here.send("PUB greeting 5", "hello")
        assert [there.hears(), there.hears()] == ["MSG greeting 1 5", "hello"]
        here.close()
        there.close()


def test_a_link_is_cut_and_mended(server):
    with Link(server.port) as link:
        client = Plain(link.port)
        assert client.hears() == "PONG"
        link.cut()
        assert client.hears() == ""
        with socket.create_connection(("127.0.0.1", link.port), timeout=PATIENCE) as refused:
            assert refused.recv(1) == b""
        link.mend()
        again = Plain(link.port)
        assert again.hears() == "PONG"
        again.close()
        client.close()


def test_a_link_that_is_held_passes_on_later_what_was_sent(server):
    with Link(server.port) as link:
        client = Plain(link.port)
        assert client.hears() == "PONG"
        link.hold()
        assert not client.is_answered_within(0.2)
        link.mend()
        assert client.hears() == "PONG"
        client.close()
