"""The web page of a gateway in virtual time, and browsers that have no socket either."""

import asyncio
import json
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import cache
from http.client import HTTPResponse
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch
from urllib.parse import urlencode

from gateway.observe.fan_out import FanOut
from gateway.observe.last_events import LastEvents
from gateway.operator.operations.table import OPERATIONS
from gateway.operator.operator import Operator
from gateway.operator.trends.kept import trends_kept
from gateway.readconfig.reader import read_here
from gateway.runtime.reload import Reloader
from gateway.runtime.running import Running
from gateway.service.systemd import Notifier
from gateway.state.applied_configs import AppliedConfigs
from gateway.timing.history import History
from gateway.web.front.server import serving
from gateway.web.front.settings import WebSettings
from gateway.web.pages.assets import Assets
from kit.gateway_bench import PATIENCE, GatewayBench, gateway_bench

#: `correct horse`, at a cost that a test can bear.
CHEAP_HASH = "$scrypt$ln=1,r=1,p=1$AAAAAAAAAAAAAAAAAAAAAA==$PQkVTyyHF9mCETQ+ge6tRpm4yd+InBk92ykpHodz/ds="
PASSWORD = "correct horse"
USERS = f"anna:operator:{CHEAP_HASH}\nvera:viewer:{CHEAP_HASH}\n"
HOST = "127.0.0.1:8502"
#: When virtual time begins: the first of May 2026, 12:00 UTC.
CLOCK = 1_777_636_800.0


class Page(NamedTuple):
    status: int
    headers: Any
    text: str

    @property
    def json(self) -> Any:
        return json.loads(self.text)

    @property
    def problem(self) -> str:
        """What a problem says."""
        assert self.headers["Content-Type"].startswith("application/problem+json")
        assert self.json["status"] == self.status
        return self.json["detail"]


class Wire(asyncio.Transport):
    """A connection in memory. With `room` its other end takes so many bytes and then no more."""

    def __init__(self, protocol: Any, host: str, room: int | None = None) -> None:
        super().__init__({"peername": (host, 50000), "sockname": ("127.0.0.1", 8502)})
        self.received = bytearray()
        self.closed = asyncio.Event()
        self.protocol = protocol
        self._room = room
        protocol.connection_made(self)

    def arrive(self, data: bytes) -> None:
        """The other end has sent this."""
        while data and not self.is_closing():
            room = self.protocol.get_buffer(-1)[: len(data)]
            room[:] = data[: len(room)]
            self.protocol.buffer_updated(len(room))
            data = data[len(room) :]

    def write(self, data: bytes) -> None:
        self.received += data
        if self._room is not None and len(self.received) >= self._room:
            self._room = None
            self.protocol.pause_writing()

    def writelines(self, chunks: Any) -> None:
        self.write(b"".join(chunks))

    def set_protocol(self, protocol: Any) -> None:
        self.protocol = protocol

    def is_closing(self) -> bool:
        return self.closed.is_set()

    def close(self) -> None:
        if not self.closed.is_set():
            self.closed.set()
            asyncio.get_running_loop().call_soon(self.protocol.connection_lost, None)

    def abort(self) -> None:
        self.close()

    def pause_reading(self) -> None:
        pass

    def resume_reading(self) -> None:
        pass

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        pass


class Browser:
    """Somebody at `host` who keeps cookies, and sends the Origin and the CSRF token that a page of ours would send."""

    def __init__(self, connect: Any, host: str = "127.0.0.1", name: str = HOST) -> None:
        self._connect = connect
        self._host = host
        self.name = name
        self.cookies: dict[str, str] = {}
        self.csrf = ""

    def open(
        self,
        path: str,
        *,
        method: str = "GET",
        body: bytes = b"",
        headers: dict[str, str | None] | None = None,
        room: int | None = None,
    ) -> Wire:
        """Ask for a page and leave the connection open."""
        wire = Wire(self._connect(None), self._host, room)
        length = {"Content-Length": str(len(body))} if body else {}
        head = self._head(method, path, {**length, **(headers or {})})
        wire.arrive(head.encode(errors="surrogateescape") + b"\r\n" + body)
        return wire

    async def ask(
        self, method: str, path: str, body: bytes = b"", headers: dict[str, str | None] | None = None
    ) -> Page:
        """One request over a connection of its own. A header that is None is not sent."""
        wire = self.open(path, method=method, body=body, headers={"Connection": "close", **(headers or {})})
        async with asyncio.timeout(PATIENCE):
            await wire.closed.wait()
        page = _page(bytes(wire.received), method)
        for cookie in page.headers.get_all("Set-Cookie") or []:
            name, _, value = cookie.partition(";")[0].partition("=")
            self.cookies[name] = value.strip('"')
        return page

    async def get(self, path: str, **headers: str) -> Page:
        return await self.ask("GET", path, headers={name.replace("_", "-"): text for name, text in headers.items()})

    async def put(self, path: str, values: object, **headers: str | None) -> Page:
        return await self._change("PUT", path, json.dumps({"values": values}).encode(), "application/json", headers)

    async def post(self, path: str, form: dict[str, str] | None = None, **headers: str | None) -> Page:
        return await self._change(
            "POST", path, urlencode(form or {}).encode(), "application/x-www-form-urlencoded", headers
        )

    async def log_in(self, user: str, password: str = PASSWORD) -> Page:
        page = await self.post("/login", {"user": user, "password": password}, Accept="application/json")
        if page.status == 200:
            self.csrf = page.json["csrf"]
        return page

    async def _change(self, method: str, path: str, body: bytes, kind: str, headers: dict[str, str | None]) -> Page:
        usual = {"Origin": f"http://{self.name}", "Content-Type": kind, "X-CSRF-Token": self.csrf or None}
        own = {name.replace("_", "-"): text for name, text in headers.items()}
        return await self.ask(method, path, body, {**usual, **own})

    def _head(self, method: str, path: str, headers: dict[str, str | None]) -> str:
        cookies = "; ".join(f"{name}={value}" for name, value in self.cookies.items())
        sent = {"Host": self.name, "Cookie": cookies or None, **headers}
        fields = "".join(f"{name}: {text}\r\n" for name, text in sent.items() if text is not None)
        return f"{method} {path} HTTP/1.1\r\n{fields}"


class WebBench(NamedTuple):
    """A gateway with a web page. `connect` makes the protocol of a connection; the `history` is the test's to fill."""

    inner: GatewayBench
    running: Running
    fan_out: FanOut
    connect: Any
    users: Path
    history: History
    operator: Operator

    def browser(self, host: str = "127.0.0.1", name: str = HOST) -> Browser:
        return Browser(self.connect, host, name)

    def events(self, name: str) -> list[Any]:
        return [event for event in self.inner.events if event.name == name]


@asynccontextmanager
async def web_bench(config: str, folder: Path, operations: Any = OPERATIONS, trends: float = 0.0, **settings: Any):
    """A gateway with this config, and its web page; in `folder` are the users, anna the operator and vera.

    `trends` are kept for so many seconds, in memory.
    """
    users = folder / "users"
    users.write_text(USERS)
    users.chmod(0o600)
    file = folder / "gateway.toml"
    file.write_text(config)
    async with gateway_bench(config) as home:
        running, loop = home.running, asyncio.get_running_loop()
        fan_out = FanOut(home.events.append, LastEvents(lambda: CLOCK + loop.time()))
        running.emit = fan_out.emit
        running.ready.set()
        applied = AppliedConfigs(folder / "state", file.name, running.emit, lambda: CLOCK + loop.time())
        reloader = Reloader(file, running, Notifier({}), text=config, read=read_here, applied=applied)
        asked = WebSettings("127.0.0.1", 8502, users=users, write=True)
        history = History()
        operator = Operator(running, reloader, lambda: CLOCK + loop.time(), fan_out.last)
        operator.history = history
        settles = patch("gateway.runtime.garbage.settle")  # after a reload: that looks at the objects of all tests
        with settles, patch("gateway.web.front.server.Assets", _assets):
            serves = serving(replace(asked, **settings), operator, fan_out, operations)
            async with trends_kept(operator, trends, None), serves as connect:
                yield WebBench(home, running, fan_out, connect, users, history, operator)


@cache
def _assets() -> Assets:
    """Read and packed once for all tests."""
    return Assets()


def _page(data: bytes, method: str) -> Page:
    class Socket:
        def makefile(self, *_: object) -> BytesIO:
            return BytesIO(data)

    response = HTTPResponse(Socket(), method=method)  # type: ignore[arg-type]
    response.begin()
    return Page(response.status, response.headers, response.read().decode())
