"""Debian's nats-server: a real one on a port of its own, which can be stopped, killed and halted."""

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self
from urllib.request import urlopen

from kit.free_port import free_port
from kit.hub import write_hub
from kit.link import Link
from kit.process import PATIENCE
from kit.programs import find

#: Ports and folder in the configs that `fleet hub` writes, and the address of the hub there.
_IN_CONFIG = ("127.0.0.1:4222", "127.0.0.1:7422", "127.0.0.1:8222", "/var/lib/nats", "hub.plant.example:7422")


class NatsServer:
    """A server with JetStream; in its context it runs, and after a restart it has its port, address and buckets again.

    `settings` are lines of its config, such as `authorization { … }`. `leaf_of` is the hub whose leaf node it is;
    then `domain` is its JetStream's name, which must differ from the hub's. `user` is "NAME:PASSWORD" at the hub.
    With `config`, one that `fleet hub` has written, all of that stands there.
    """

    def __init__(
        self,
        folder: Path,
        settings: str = "",
        *,
        domain: str = "",
        leaf_of: "NatsServer | None" = None,
        user: str = "",
        config: str = "",
    ) -> None:
        self.port, self.leaf_port, self._monitor = free_port(), free_port(), free_port()
        self._config = folder / f"nats-{self.port}.conf"
        self._log = folder / f"nats-{self.port}.log"
        self._store = store = folder / f"nats-{self.port}"
        self._older_store = folder / f"nats-{self.port}.older"
        hub = f"127.0.0.1:{self.leaf_port if leaf_of is None else leaf_of.leaf_port}"
        self._own = (f"127.0.0.1:{self.port}", hub, f"127.0.0.1:{self._monitor}", str(store), hub)
        if config:
            self._config.write_text(self._moved(config))
            return
        lines = [
            f"server_name: {domain or f'nats-{self.port}'}",
            f"listen: 127.0.0.1:{self.port}",
            f"http: 127.0.0.1:{self._monitor}",
            f'jetstream {{ store_dir: "{store}"{f", domain: {domain}" if domain else ""} }}',
        ]
        if leaf_of is None:
            lines.append(f"leafnodes {{ listen: {hub} }}")
        else:
            remote = f"nats-leaf://{f'{user}@' if user else ''}{hub}"
            lines.append(f'leafnodes {{ reconnect: 1, remotes: [{{ url: "{remote}" }}] }}')
        self._config.write_text("\n".join((*lines, settings, "")))

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    @property
    def url(self) -> str:
        """Its address, without a user."""
        return f"nats://127.0.0.1:{self.port}"

    @property
    def log(self) -> str:
        """What it has logged."""
        return self._log.read_text(errors="replace")

    @property
    def pid(self) -> int:
        return self._process.pid

    def reload(self, config: Path) -> None:
        """Let it read another config that `fleet hub` has written, without a restart. A new site needs two reloads."""
        self._config.write_text(self._moved(config.read_text()))
        reloads = self.log.count("Reloaded server configuration")
        self._process.send_signal(signal.SIGHUP)
        self.wait_until(lambda: self.log.count("Reloaded server configuration") > reloads, "reloaded")

    def _moved(self, config: str) -> str:
        """Give a config the ports and the folder of this server."""
        for theirs, own in zip(_IN_CONFIG, self._own, strict=True):
            config = config.replace(theirs, own)
        return config

    def start(self) -> None:
        """Start it, and wait until clients can connect and its JetStream can be used."""
        with self._log.open("ab") as log:
            words = [str(find("nats-server")), "-c", str(self._config)]
            self._process = subprocess.Popen(words, stdout=log, stderr=log)
        self.wait_until(lambda: self.told("healthz?js-enabled=true")["status"] == "ok", "ready")

    def stop(self) -> None:
        """End it as its service is stopped: it says so to its clients."""
        self._process.terminate()
        self.resume()
        self._process.wait(PATIENCE)

    def kill(self) -> None:
        """End it as a power cut would, halted or not."""
        self._process.kill()
        self._process.wait()

    def restart(self) -> None:
        """`kill -9`, then start."""
        self.kill()
        self.start()

    def keep_store(self) -> None:
        """Restart it, and keep a copy of what its JetStream holds now."""
        self.kill()
        shutil.rmtree(self._older_store, ignore_errors=True)
        shutil.copytree(self._store, self._older_store)
        self.start()

    def roll_back(self) -> None:
        """While it does not run: give its JetStream what it held when that was kept."""
        shutil.rmtree(self._store)
        shutil.copytree(self._older_store, self._store)

    def halt(self) -> None:
        """SIGSTOP, and wait until it stands still: its connections stay open, and nothing is answered."""
        self._process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.pid, os.WSTOPPED)

    def resume(self) -> None:
        """SIGCONT."""
        self._process.send_signal(signal.SIGCONT)

    def told(self, page: str) -> dict[str, Any]:
        """A page of its monitoring, such as `varz`, `connz?subs=1`, `leafz` or `jsz`."""
        with urlopen(f"http://127.0.0.1:{self._monitor}/{page}", timeout=PATIENCE) as answer:
            return json.load(answer)

    def wait_for_leaves(self, count: int = 1) -> None:
        """Wait until it has so many connections to leaf nodes, or as a leaf node to its hub."""
        self.wait_until(lambda: self.told("leafz")["leafnodes"] == count, f"{count} leaf nodes")

    def wait_until(self, condition: Callable[[], bool], what: str) -> None:
        """Wait until something is so; pages that it cannot tell yet count as no."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            assert self._process.poll() is None, self.log
            try:
                if condition():
                    return
            except OSError:
                pass
            time.sleep(0.02)
        raise AssertionError(f"not {what}: {self.log}")


@contextmanager
def hub_and_leaf(folder: Path) -> Iterator[tuple[NatsServer, Link, NatsServer]]:
    """The servers of `fleet hub`, with a link on the way from the leaf node to the hub; logins are in `folder`/hub."""
    way = free_port()
    made = write_hub(folder).folder
    configs = ((made / name).read_text() for name in ("hub.conf", "plant-3.leaf.conf"))
    hub, leaf = (text.replace("hub.plant.example:7422", f"127.0.0.1:{way}") for text in configs)
    with (
        NatsServer(folder, config=hub) as server,
        Link(server.leaf_port, way) as link,
        NatsServer(folder, config=leaf) as node,
    ):
        node.wait_for_leaves()
        yield server, link, node
