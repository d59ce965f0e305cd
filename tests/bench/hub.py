"""The hub of many sites as `fleet hub` writes it: time, size, memory, and a reload while all sites are connected.

    .venv/bin/python tests/bench/hub.py [--sites 500]

Each site has a connection of a gateway: a heartbeat that control hears, a unit that control asks, and its status in the
bucket. Then one more site is added, and the server reads its config again. It ends with status 1 if a site was
disconnected by that, or could not be asked before or after.
"""

import argparse
import asyncio
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from used import resident

sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.fleet.connection import NatsConnection
from gateway.fleet.messages import Message
from gateway.fleet.settings import Login, Server
from gateway.fleet.subjects import STATUS, all_answers, answer_folder, clock_subject, request_subject
from kit.hub import write_hub
from kit.nats import NatsServer
from kit.programs import find

READ = bytes((3, 0, 0, 0, 10))


def sites_of(count: int) -> str:
    names = ", ".join(f'"site-{number:03}"' for number in range(count))
    return f'control = "control"\nsites = [{names}]\n'


@contextmanager
def timed(what: str) -> Iterator[None]:
    began = time.monotonic()
    yield
    print(f"{what}: {time.monotonic() - began:.2f} s", flush=True)


class Fleet:
    """The connections of all sites, and the answers that control has got."""

    def __init__(self, folder: Path, server: NatsServer) -> None:
        self._folder = folder
        self._server = Server("127.0.0.1", server.port)
        self.sites: dict[str, NatsConnection] = {}
        self._answers: set[str] = set()

    async def connect(self, site: str) -> None:
        credentials = (self._folder / f"{site}.creds").read_text()
        connection = self.sites[site] = NatsConnection(self._server, Login(site, credentials=credentials))
        await connection.open()
        if site == "control":
            await connection.subscribe(all_answers(site), lambda told: self._answers.add(told.subject.split(".")[3]))
            await connection.subscribe(clock_subject("*"), lambda _: None)
        else:
            await connection.subscribe(request_subject(site, 1, "*"), partial(self._answer, connection), "mbgw")
        bucket = await connection.bucket(STATUS)
        await bucket.put(site, b'{"host": "gw"}')

    async def ask_all(self) -> bool:
        """Let control ask each site once; return whether all have answered within ten seconds."""
        self._answers.clear()
        control = self.sites["control"]
        others = self.sites.keys() - {"control"}
        for site in others:
            reply = f"{answer_folder('control', site)}1"
            control.publish(Message(request_subject(site, 1, "control"), READ, reply))
        for _ in range(1000):
            if self._answers >= others:
                return True
            await asyncio.sleep(0.01)
        return False

    def lost(self) -> list[str]:
        return [site for site, connection in self.sites.items() if connection.lost.done()]

    @staticmethod
    def _answer(connection: NatsConnection, asked: Message) -> None:
        connection.publish(Message(asked.reply, b"\x03\x14" + bytes(20)))


async def measure(folder: Path, count: int) -> bool:
    with timed(f"{count} sites and control, made"):
        made = write_hub(folder, sites_of(count)).folder
    config = made / "hub.conf"
    lines = config.read_text().count("\n")
    print(f"hub.conf: {config.stat().st_size / 1e6:.2f} MB, {lines} lines")
    with timed("nats-server -t -c"):
        test = await asyncio.create_subprocess_exec(str(find("nats-server")), "-t", "-c", str(config))
        assert await test.wait() == 0
    server = NatsServer(folder, config=config.read_text())
    with timed("start"):
        server.start()
    try:
        print(f"memory of the hub, nobody connected: {resident(server.pid) / 1024:.0f} MiB")
        fleet = Fleet(made, server)
        with timed("all connect, and say how they are"):
            for site in ("control", *(f"site-{number:03}" for number in range(count))):
                await fleet.connect(site)
        print(f"memory of the hub, all connected: {resident(server.pid) / 1024:.0f} MiB")
        with timed("control asks each once"):
            is_good = await fleet.ask_all()
        with timed("control reads the status of all"):
            entries = await (await fleet.sites["control"].bucket(STATUS)).entries()
        is_good &= len(entries) == count + 1
        with timed("one more site, made"):
            write_hub(folder, sites_of(count + 1))
        with timed("reload, twice"):
            await asyncio.to_thread(server.reload, config)
            await asyncio.to_thread(server.reload, config)
        await fleet.connect(f"site-{count:03}")
        with timed("control asks each once, the new one too"):
            is_good &= await fleet.ask_all()
        lost = fleet.lost()
        print(f"memory of the hub: {resident(server.pid) / 1024:.0f} MiB; disconnected: {len(lost)}")
        for connection in fleet.sites.values():
            await connection.close()
        return is_good and not lost
    finally:
        server.kill()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sites", type=int, default=500)
    with tempfile.TemporaryDirectory() as folder:
        is_good = asyncio.run(measure(Path(folder), parser.parse_args().sites))
    return 0 if is_good else 1


if __name__ == "__main__":
    sys.exit(main())
