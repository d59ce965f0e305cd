"""Debian's mosquitto: a real broker on a port of its own, and programs that publish and listen there."""

import asyncio
import itertools
import json
import signal
import socket
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from pathlib import Path
from queue import Empty, Queue
from typing import Any, NamedTuple, Self

from aiohttp import WSMsgType, web

from kit.free_port import free_port
from kit.process import PATIENCE
from kit.programs import find


class Mosquitto:
    """A broker; in its context it runs. `settings` are lines of its config for the listener."""

    def __init__(self, folder: Path, *settings: str, anonymous: bool = True) -> None:
        self.port = free_port()
        self._config = folder / f"mosquitto-{self.port}.conf"
        self._log = folder / f"mosquitto-{self.port}.log"
        user = f"user {'root' if folder.owner() == 'root' else folder.owner()}"
        allow = f"allow_anonymous {'true' if anonymous else 'false'}"
        lines = (f"listener {self.port} 127.0.0.1", user, allow, "log_type all", *settings)
        self._config.write_text("\n".join(lines) + "\n")

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self) -> None:
        """Start it, and wait until it listens."""
        with self._log.open("ab") as log:
            self._process = subprocess.Popen([str(find("mosquitto")), "-c", str(self._config)], stdout=log, stderr=log)
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            assert self._process.poll() is None, self.log
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1.0).close()
            except OSError:
                time.sleep(0.02)
            else:
                return
        raise AssertionError(self.log)

    def kill(self) -> None:
        """End it as a power cut would."""
        self._process.kill()
        self._process.wait()

    def signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self._process.send_signal(number)

    def wait(self) -> None:
        """Wait until it has ended."""
        self._process.wait(PATIENCE)

    def reload(self) -> None:
        """Read the files again."""
        self.signal(signal.SIGHUP)

    @property
    def log(self) -> str:
        """What it has logged."""
        return self._log.read_text(errors="replace")

    def wait_for_log(self, text: str, known: int = 0) -> None:
        """Wait until it has logged this, behind so many characters."""
        deadline = time.monotonic() + PATIENCE
        while text not in self.log[known:]:
            assert time.monotonic() < deadline, self.log
            time.sleep(0.02)

    def publish(self, topic: str, payload: str, *options: str) -> None:
        """Publish a message, with QoS 1."""
        command = [
            "mosquitto_pub",
            "-h",
            "127.0.0.1",
            "-p",
            str(self.port),
            "-q",
            "1",
            "-t",
            topic,
            "-m",
            payload,
            *options,
        ]
        subprocess.run(command, check=True, timeout=PATIENCE, capture_output=True)


class Heard(NamedTuple):
    """A message as a subscriber got it. `retained`: the broker had it before the subscription."""

    topic: str
    payload: str
    retained: bool

    @property
    def content(self) -> dict[str, Any]:
        """Its JSON."""
        return json.loads(self.payload)


class Subscriber:
    """mosquitto_sub: everything that a broker publishes below `topic`, from the beginning of its context on.

    `latest` is the last payload of each topic.
    """

    _numbers = itertools.count(1)

    def __init__(self, broker: Mosquitto, topic: str = "#", options: tuple[str, ...] = ()) -> None:
        self.heard: list[Heard] = []
        self._broker = broker
        self._name = f"subscriber-{next(self._numbers)}"
        self._messages: Queue[Heard | None] = Queue()
        own = ("-h", "127.0.0.1", "-p", str(broker.port), "-i", self._name)
        self._command = ["mosquitto_sub", *own, "-q", "1", "-t", topic, "-F", "%j", *options]

    def __enter__(self) -> Self:
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read, name="subscriber")
        self._reader.start()
        self._broker.wait_for_log(f"Sending SUBACK to {self._name}")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join()
        self._process.stdout.close()

    @property
    def latest(self) -> Mapping[str, str]:
        """The last payload of each topic, of what was heard so far."""
        return {each.topic: each.payload for each in list(self.heard)}

    def wait_for(self, topic: str, payload: str | None = None, **content: object) -> Heard:
        """The next message on a topic with this payload, or with this content as JSON."""
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                found = self._messages.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                found = None
            assert found is not None, f"nothing like {payload or content} on {topic}; heard: {self.heard[-50:]}"
            if found.topic != topic or payload not in (None, found.payload):
                continue
            if not content or content.items() <= found.content.items():
                return found

    def wait_until(self, is_so: Callable[[], object]) -> None:
        """Wait until something is so with what was heard."""
        deadline = time.monotonic() + PATIENCE
        while not is_so():
            assert time.monotonic() < deadline, self.heard[-50:]
            time.sleep(0.02)

    def _read(self) -> None:
        for line in self._process.stdout:
            told = json.loads(line)
            heard = Heard(told["topic"], told.get("payload", ""), bool(told["retain"]))
            self.heard.append(heard)
            self._messages.put(heard)
        self._messages.put(None)


class OlderBroker:
    """A broker that only has MQTT 3.1.1, as one that is newer is seen through it. In its context it listens."""

    #: The answer of MQTT 3.1.1 to a version that a broker does not have.
    REFUSAL = bytes((0x20, 2, 0, 1))

    def __init__(self, broker: int) -> None:
        self.port = free_port()
        self._broker = broker

    def __enter__(self) -> Self:
        self._listener = socket.create_server(("127.0.0.1", self.port))
        self._sockets = [self._listener]
        self._threads = [threading.Thread(target=self._accept)]
        self._threads[0].start()
        return self

    def __exit__(self, *_: object) -> None:
        for each in self._sockets:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()
        for thread in self._threads:
            thread.join()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                self._sockets.append(client)
                begin = client.recv(4096)
                name = begin.find(b"MQTT")
                if begin[name + 4] == 5:
                    client.sendall(self.REFUSAL)
                    client.close()
                    continue
                broker = socket.create_connection(("127.0.0.1", self._broker))
                self._sockets.append(broker)
                broker.sendall(begin)
                for source, target in ((client, broker), (broker, client)):
                    self._threads.append(threading.Thread(target=_pass_on, args=(source, target)))
                    self._threads[-1].start()


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(65536):
            target.sendall(data)


class WebSocketDoor:
    """Takes WebSocket connections for a broker: not every mosquitto can. With a `context` they are encrypted."""

    def __init__(self, broker: int, context: ssl.SSLContext | None = None) -> None:
        self.port = free_port()
        self._broker = broker
        self._context = context
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="websockets")

    def __enter__(self) -> Self:
        self._thread.start()
        app = web.Application()
        app.router.add_get("/mqtt", self._pass)
        self._runner = web.AppRunner(app, shutdown_timeout=0.1)
        self._do(self._runner.setup())
        self._do(web.TCPSite(self._runner, "127.0.0.1", self.port, ssl_context=self._context).start())
        return self

    def __exit__(self, *_: object) -> None:
        self._do(self._runner.cleanup())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _do(self, step: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(step, self._loop).result(PATIENCE)

    async def _pass(self, request: web.Request) -> web.WebSocketResponse:
        client = web.WebSocketResponse(protocols=("mqtt",))
        await client.prepare(request)
        reader, writer = await asyncio.open_connection("127.0.0.1", self._broker)

        async def answer() -> None:
            while data := await reader.read(65536):
                await client.send_bytes(data)

        answering = asyncio.create_task(answer())
        async for message in client:
            if message.type is WSMsgType.BINARY:
                writer.write(message.data)
        answering.cancel()
        writer.close()
        return client
