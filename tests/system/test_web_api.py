"""The web page and its API on a gateway that runs: over TLS, by its document, and with browsers that do not read."""

import http.cookiejar
import json
import signal
import socket
import ssl
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from urllib.error import HTTPError

import hypothesis
import pytest

from kit.pki import openssl
from kit.process import COMMAND, PATIENCE, GatewayProcess

CONFIG = """
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{folder}/hall"
devices = [{{ unit = 1, as = 41, name = "silo-1", profile = "weigher" }}]

[[line]]
name = "panel"
port = "{folder}/panel"
role = "server"
serves = [200]

[[image]]
unit = 200
name = "shift"
holding = 400
coils = 40
profile = "shift"

[[image]]
unit = 241
of = "silo-1"
read = [{{ holding = "0-1", every = "1 s" }}]

[profile.shift]
points = [{{ name = "speed", holding = 0, type = "int32", write = true }}, {{ name = "gone", holding = 999 }}]

[web]
bind = "{scheme}://127.0.0.1:0"
users = "{folder}/users"
write = true
{more}
"""
PASSWORD = "correct horse"


class Web(GatewayProcess):
    """A gateway with a web page, and an operator who is at it."""

    def __init__(self, folder: Path, scheme: str = "http", more: str = "") -> None:
        super().__init__(folder, CONFIG.format(folder=folder, scheme=scheme, more=more), level="info")
        users = folder / "users"
        users.write_text(operators())
        users.chmod(0o600)
        self.csrf = ""

    def __enter__(self):
        super().__enter__()
        self.address = next((event["address"] for event in self.log if event["event"] == "web_up"), "")
        context = ssl._create_unverified_context()
        self.cookies = http.cookiejar.CookieJar()
        self._opener = urllib.request.build_opener(
            urllib.request.HTTPSHandler(context=context), urllib.request.HTTPCookieProcessor(self.cookies)
        )
        return self

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, str]:
        own = {"Origin": self.address, "X-CSRF-Token": self.csrf, "Content-Type": "application/json"}
        request = urllib.request.Request(self.address + path, body, {**own, **headers}, method=method)
        try:
            with self._opener.open(request, timeout=PATIENCE) as response:
                return response.status, response.read().decode()
        except HTTPError as error:
            return error.code, error.read().decode()

    def log_in(self) -> None:
        form = f"user=anna&password={PASSWORD.replace(' ', '+')}".encode()
        kind = {"Content-Type": "application/x-www-form-urlencoded", "Accept": "application/json"}
        status, text = self.ask("POST", "/login", form, **kind)
        assert status == 200
        self.csrf = json.loads(text)["csrf"]


@cache
def operators() -> str:
    """The file in which `anna` may operate, made once."""
    with TemporaryDirectory() as folder:
        user(Path(folder), "add", "anna", "--role", "operator")
        return (Path(folder) / "users").read_text()


def user(folder: Path, *words: str) -> None:
    subprocess.run(
        [*COMMAND, "user", *words, "--file", str(folder / "users")],
        input=PASSWORD,
        text=True,
        check=True,
        capture_output=True,
    )


def make_certificate(folder: Path) -> str:
    subject = ["-subj", "/CN=localhost", "-days", "2", "-nodes", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]
    files = ["-keyout", str(folder / "key"), "-out", str(folder / "crt")]
    openssl("req", "-x509", *subject, *files)
    (folder / "key").chmod(0o600)
    return f'certificate = "{folder}/crt"\nkey = "{folder}/key"\n'


def test_a_write_arrives_once_and_is_audited_by_name(tmp_path):
    with Web(tmp_path) as gateway:
        gateway.log_in()
        assert gateway.ask("PUT", "/api/v1/units/shift/points/speed", b'{"values": [-7]}')[0] == 200
        status, text = gateway.ask("GET", "/api/v1/units/200/holding/0?type=int32")
        assert (status, json.loads(text)["values"][0]["value"]) == (200, -7)
        assert gateway.stop() == 0
        (audit,) = [event for event in gateway.log if event["event"] == "write_audit"]
        assert (audit["client"], audit["result"], audit["count"]) == ("web:anna@127.0.0.1", "ok", 2)
        assert PASSWORD not in json.dumps(gateway.log)
        assert gateway.csrf not in json.dumps(gateway.log)


def test_a_user_who_is_removed_is_out_soon(tmp_path):
    with Web(tmp_path) as gateway:
        gateway.log_in()
        user(tmp_path, "remove", "anna")
        end = time.monotonic() + PATIENCE
        while gateway.ask("PUT", "/api/v1/units/shift/points/speed", b'{"values": [-7]}')[0] != 401:
            assert time.monotonic() < end
            time.sleep(0.2)
        assert gateway.ask("POST", "/api/v1/reload")[0] == 401


def test_a_reload_is_ordered_over_http(tmp_path):
    with Web(tmp_path) as gateway:
        gateway.log_in()
        gateway.config.write_text(gateway.config.read_text().replace('name = "shift"', 'name = "later"'))
        status, text = gateway.ask("POST", "/api/v1/reload")
        assert (status, json.loads(text)["added"]) == (200, ["image later"])
        assert gateway.ask("GET", "/api/v1/units/later")[0] == 200
        assert gateway.stop() == 0


def test_https_takes_tls_1_2_and_newer_and_the_cookie_is_secure(tmp_path):
    with Web(tmp_path, "https", make_certificate(tmp_path)) as gateway:
        gateway.log_in()
        (cookie,) = gateway.cookies
        assert cookie.secure
        assert cookie.name == "__Host-mbgw"
        port = int(gateway.address.rpartition(":")[2])
        assert spoken(port) == "TLSv1.3"
        assert spoken(port, ssl.TLSVersion.TLSv1_2) == "TLSv1.2"
        with pytest.raises(OSError), pytest.warns(DeprecationWarning, match="TLSv1_1"):  # noqa: PT011 - ssl.SSLError, or a reset
            spoken(port, ssl.TLSVersion.TLSv1_1)
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as plain:
            plain.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert b"200 OK" not in plain.recv(1000)
        assert gateway.stop() == 0
        assert gateway.rest == []


def spoken(port: int, version: ssl.TLSVersion | None = None) -> str | None:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if version is not None:
        context.minimum_version = context.maximum_version = version
        context.set_ciphers("ALL:@SECLEVEL=0")
    with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE) as sock, context.wrap_socket(sock) as tls:
        return tls.version()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: (folder / "key").chmod(0o644), "others may read"),
        (lambda folder: (folder / "key").unlink(), "key: no such file"),
        (lambda folder: (folder / "crt").write_text("nonsense"), ""),
        (lambda folder: (folder / "users").chmod(0o644), "chmod o=,g-w"),
        (lambda folder: (folder / "users").unlink(), "No such file"),
        (lambda folder: (folder / "users").write_text("anna\n"), "users:1"),
    ],
)
def test_what_cannot_be_used_is_told_and_the_lines_work(tmp_path, spoil, said):
    gateway = Web(tmp_path, "https", make_certificate(tmp_path))
    spoil(tmp_path)
    with gateway:
        (closed,) = (event for event in gateway.log if event["event"] == "web_closed")
        assert said in closed["reason"]
        assert gateway.stop() == 0
        assert gateway.rest == []


def test_a_credential_of_systemd_is_a_key(tmp_path, monkeypatch):
    make_certificate(tmp_path)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    more = 'certificate = { credential = "crt" }\nkey = { credential = "key" }\n'
    with Web(tmp_path, "https", more) as gateway:
        assert gateway.ask("GET", "/healthz") == (200, "ok\n")


@pytest.mark.search
def test_browsers_that_do_not_read_cost_nothing_and_are_dropped(tmp_path):
    with Web(tmp_path) as gateway, unread(gateway, 5) as sockets:
        before = gateway.memory()
        clients = [socket.create_connection(("127.0.0.1", gateway.port), timeout=PATIENCE) for _ in range(4)]
        end = time.monotonic() + PATIENCE
        denied = bytes.fromhex("0001 0000 0006 63 06 0000 0001")  # a write to a unit that nobody has
        while time.monotonic() < end and not all(map(is_closed, sockets)):
            for client in clients:
                client.sendall(denied * 10)
                client.recv(4096)
            time.sleep(0.02)
        assert all(map(is_closed, sockets))
        assert gateway.memory() - before < 20_000
        assert gateway.ask("GET", "/healthz")[0] == 200
        for client in clients:
            client.close()
        assert gateway.stop() == 0


@contextmanager
def unread(gateway: Web, number: int) -> Iterator[list[socket.socket]]:
    """Readers of events that read nothing."""
    sockets = []
    for _ in range(number):
        sock = socket.socket()
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        sock.connect(("127.0.0.1", int(gateway.address.rpartition(":")[2])))
        sock.sendall(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        sockets.append(sock)
    try:
        yield sockets
    finally:
        for sock in sockets:
            sock.close()


def is_closed(sock: socket.socket) -> bool:
    """Whether the other end has reset the connection."""
    return sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 1)[0] != 1  # TCP_ESTABLISHED


def test_open_streams_do_not_delay_the_end(tmp_path):
    with Web(tmp_path) as gateway, unread(gateway, 3) as sockets:
        for sock in sockets:
            assert sock.recv(15) == b"HTTP/1.1 200 OK"
        before = time.monotonic()
        assert gateway.stop() == 0
        assert time.monotonic() - before < PATIENCE / 2
        assert gateway.rest == []


#: Names that are there, beside those that hypothesis finds.
KNOWN: dict[str, list[Any]] = {"unit": ["200", "shift", "41", "241", "99"], "name": ["hall", "panel", "speed", "gone"]}


@pytest.mark.search
def test_the_document_says_what_is_answered(tmp_path):
    import schemathesis  # noqa: PLC0415 - a tenth of what all of these tests import, and nobody else needs it

    with Web(tmp_path) as gateway:
        gateway.log_in()
        cookie = "; ".join(f"{each.name}={each.value}" for each in gateway.cookies)
        sent = {"Cookie": cookie, "Origin": gateway.address, "X-CSRF-Token": gateway.csrf}
        document = json.loads(gateway.ask("GET", "/api/v1/openapi.json")[1])
        schema = schemathesis.openapi.from_dict(document)
        operations = [each.ok() for each in schema.get_all_operations()]
        tried = {operation.label: tried_out(operation, gateway.address, sent) for operation in operations}
        documented = {(path, way) for path, ways in document["paths"].items() for way in ways.keys() - {"parameters"}}
        assert set(tried) == {f"{way.upper()} {path}" for path, way in documented}
        assert gateway.ask("GET", "/healthz")[0] == 200
        assert not [event for event in gateway.log if event["event"] == "part_failed"]
        for label in (
            "GET /api/v1/units/{unit}/{area}/{start}-{end}",
            "PUT /api/v1/units/{unit}/{area}/{start}-{end}",
            "PUT /api/v1/units/{unit}/points/{name}",
        ):
            assert 200 in tried[label], (label, tried[label])


def make_sensible(case: Any, data: Any) -> None:
    """Ask for something that is there."""
    names = set(case.path_parameters or {})
    for name in names & set(KNOWN):
        case.path_parameters[name] = data.draw(hypothesis.strategies.sampled_from(KNOWN[name]))
    if "area" in names:
        case.path_parameters |= {"area": "holding", "start": 3, "end": 4}
        case.query = {"type": "uint32"}
    if case.method == "PUT" and names & {"name", "area"}:
        case.path_parameters |= {"unit": "shift"} | ({"name": "speed"} if "name" in names else {})
        case.body = {"values": [data.draw(hypothesis.strategies.integers(-9, 2**33))]}


def tried_out(operation: Any, address: str, sent: dict[str, str]) -> set[int]:
    """The statuses that an operation has answered with; it answers as the document says."""
    from schemathesis.specs.openapi import checks  # noqa: PLC0415

    conformance = [
        checks.status_code_conformance,
        checks.content_type_conformance,
        checks.response_headers_conformance,
        checks.response_schema_conformance,
    ]
    statuses: set[int] = set()
    if operation.path in ("/api/v1/events", "/api/v1/trace"):
        return statuses

    @hypothesis.settings(
        max_examples=6 if operation.path.endswith("/reload") else 12,  # each of which starts a process
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(hypothesis.HealthCheck),
    )
    @hypothesis.given(case=operation.as_strategy(), data=hypothesis.strategies.data())
    def try_out(case: Any, data: Any) -> None:
        if data.draw(hypothesis.strategies.booleans()):
            make_sensible(case, data)
        headers = sent if data.draw(hypothesis.strategies.booleans()) else {}
        response = case.call(base_url=address, headers=headers, timeout=PATIENCE)
        statuses.add(response.status_code)
        case.validate_response(response, checks=conformance)

    try_out()
    return statuses


def test_what_is_logged_is_told_to_those_who_follow(tmp_path):
    with Web(tmp_path) as gateway:
        request = urllib.request.Request(gateway.address + "/api/v1/events")
        with urllib.request.urlopen(request, timeout=PATIENCE) as stream:
            gateway.signal(signal.SIGHUP)
            for line in stream:
                if line.startswith(b"data: ") and json.loads(line[6:])["event"] == "config_applied":
                    break
