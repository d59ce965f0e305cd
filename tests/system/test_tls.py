"""Modbus/TCP Security in real processes: other programs' clients, certificates of every kind, and what they may do."""

import asyncio
import os
import select
import shutil
import signal
import socket
import ssl
import subprocess
import time
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, asynccontextmanager, contextmanager, suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from pymodbus.client import ModbusTlsClient

from gateway.errors import ConnectionEnded, PortClosed, PortError
from gateway.listeners.handshakes import MADE_ROOM, MOST, SLOW, TOO_MANY
from gateway.listeners.tls import OUTLIVED
from gateway.listeners.tls_stream import TOO_MUCH_BESIDE_DATA
from gateway.modbus.mbap import encode
from gateway.ports.port import Port, TcpSettings
from gateway.ports.tcp import open_tcp
from gateway.tls.contexts import load
from gateway.tls.settings import ClientTls, SecretFile
from kit.key_updater import key_updater
from kit.pki import NOT_UTF8, OPERATOR, TWO_ROLES, VIEWER, WRONG_TEXT, client_context, listener, openssl, pki, signed
from kit.process import COMMAND, PATIENCE, GatewayProcess, command

IMAGE = """
[[image]]
unit    = 200
holding = 10
"""
ROWS = """
[[access]]
role  = "operator"
allow = ["read", "write"]

[[access]]
role  = "viewer"
allow = ["read"]

[[access]]
from  = ["127.0.0.1"]
allow = ["read", "write"]
"""
READ, WRITE = bytes.fromhex("03 0000 0001"), bytes.fromhex("06 0000 0007")


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[GatewayProcess]:
    with GatewayProcess(tmp_path_factory.mktemp("gateway"), listener() + IMAGE + ROWS) as running:
        yield running


@contextmanager
def connected(port: int, context: ssl.SSLContext, own: str = "127.0.0.1") -> Iterator[ssl.SSLSocket]:
    plain = from_address(own, port)
    with plain, context.wrap_socket(plain, server_hostname="localhost") as secured:
        yield secured


def asks(client: socket.socket, pdu: bytes) -> str:
    client.sendall(encode(1, 200, pdu))
    return client.recv(260)[7:].hex()


def told(port: int, name: str, folder: Path | None = None, own: str = "127.0.0.1") -> str:
    """What a client with this certificate gets for a write: the response, or why there is none."""
    try:
        with connected(port, client_context(name, folder), own) as client:
            return asks(client, WRITE)
    except ssl.SSLError as error:
        return error.reason or ""
    except ConnectionError:
        return "closed"


def reason(gateway: GatewayProcess) -> str:
    return gateway.wait_for("client_rejected")["reason"]


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_role_decides_what_a_client_may(gateway: GatewayProcess, version: ssl.TLSVersion) -> None:
    for name, read, write in ((OPERATOR, "0302", "06"), (VIEWER, "0302", "8601"), ("nobody", "8301", "8601")):
        context = client_context(name)
        context.minimum_version = context.maximum_version = version
        with connected(gateway.port, context) as client:
            assert "GCM" in client.cipher()[0] or "CHACHA20" in client.cipher()[0]
            assert client.compression() is None
            assert asks(client, READ).startswith(read)
            assert asks(client, WRITE).startswith(write)


def test_the_account_of_a_write_names_subject_and_role(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, listener() + IMAGE + ROWS) as gateway:
        assert told(gateway.port, OPERATOR) == WRITE.hex()
        written = gateway.wait_for("write_audit")
        assert (written["subject"], written["role"], written["result"]) == ("CN=operator", "operator", "ok")
        assert told(gateway.port, VIEWER) == "8601"
        denied = gateway.wait_for("access_denied")
        assert (denied["subject"], denied["role"], denied["function"]) == ("CN=viewer", "viewer", 6)
        refused = gateway.wait_for("write_audit")
        assert (refused["subject"], refused["result"], refused["code"]) == ("CN=viewer", "denied", "01")
        assert told(gateway.port, "nobody") == "8601"
        assert gateway.wait_for("access_denied")["role"] == ""


def test_without_rows_clients_with_certificates_read(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        for name in (OPERATOR, "nobody"):
            with connected(gateway.port, client_context(name)) as client:
                assert asks(client, READ) == "03020000"
                assert asks(client, WRITE) == "8601"


def test_a_row_without_role_counts_for_certificates_only_if_it_names_the_listener(tmp_path: Path) -> None:
    named = '[[access]]\nlisten = ["remote"]\nallow = ["read", "write"]\n'
    with GatewayProcess(tmp_path, listener() + IMAGE + named) as gateway:
        assert told(gateway.port, "nobody") == WRITE.hex()


@pytest.mark.parametrize(
    ("extension", "why"),
    [
        (TWO_ROLES, "it has more than one role"),
        (WRONG_TEXT, "its role is not a UTF8String"),
        (NOT_UTF8, "its role is not a UTF8String"),
    ],
)
def test_a_malformed_role_is_no_role(tmp_path: Path, extension: str, why: str) -> None:
    signed(tmp_path, "odd", extension)
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        assert told(gateway.port, "odd", tmp_path) in ("", "closed")
        assert reason(gateway) == f"its certificate cannot be used: {why}"


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
@pytest.mark.parametrize(
    ("dates", "why"),
    [
        ("-startdate 20200101000000Z -enddate 20200102000000Z", "certificate has expired"),
        ("-startdate 21000101000000Z -enddate 21010101000000Z", "certificate is not yet valid"),
    ],
)
def test_a_certificate_that_is_not_valid_now(tmp_path: Path, version: ssl.TLSVersion, dates: str, why: str) -> None:
    signed(tmp_path, "old", at=dates)
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        context = client_context("old", tmp_path)
        context.maximum_version = version
        with suppress(ssl.SSLError, ConnectionError), connected(gateway.port, context) as client:
            assert asks(client, READ) == ""
        assert reason(gateway) == f"its certificate is refused: {why}"


def test_a_client_is_disconnected_when_its_certificate_expires(tmp_path: Path) -> None:
    with (
        GatewayProcess(tmp_path, listener() + IMAGE, level="debug") as gateway,
        connected(gateway.port, client_context(OPERATOR)) as other,
    ):
        # A machine may be so busy that a certificate expires before it is used.
        assert any(is_disconnected_in_time(gateway, tmp_path, seconds) for seconds in (8, 30, 90))
        assert asks(other, READ) == "03020000"


def is_disconnected_in_time(gateway: GatewayProcess, folder: Path, seconds: float) -> bool:
    """Whether the certificate of a client expires in so many seconds, and not before it has asked."""
    end = datetime.now(UTC) + timedelta(seconds=seconds)
    name = f"brief-{seconds}"
    signed(folder, name, at=f"-startdate 20200101000000Z -enddate {end:%Y%m%d%H%M%SZ}")
    with (
        suppress(ssl.SSLError, ConnectionError),
        connected(gateway.port, client_context(name, folder)) as client,
    ):
        if asks(client, READ) != "03020000":
            return False
        client.settimeout(PATIENCE)
        assert client.recv(1) == b""
        assert datetime.now(UTC) >= end.replace(microsecond=0)
        assert gateway.wait_for("client_closed")["reason"] == "its certificate has expired"
        return True
    return False


def test_a_revoked_certificate_and_that_of_another_authority(tmp_path: Path) -> None:
    other = tmp_path / "other"
    assert command("certificates", "authority", "--folder", str(other)).returncode == 0
    assert command("certificates", "client", "spy", "--role", OPERATOR, "--folder", str(other)).returncode == 0
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        assert told(gateway.port, "revoked") in ("SSLV3_ALERT_CERTIFICATE_REVOKED", "closed")
        assert reason(gateway) == "its certificate is refused: certificate revoked"
        assert told(gateway.port, "spy", other, "127.0.0.2") in ("TLSV1_ALERT_UNKNOWN_CA", "closed")
        assert reason(gateway) == "its certificate is refused: unable to get local issuer certificate"
        assert told(gateway.port, "", own="127.0.0.3") in ("TLSV13_ALERT_CERTIFICATE_REQUIRED", "closed")
        assert reason(gateway) == "it shows no certificate"


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_no_session_is_resumed_once_the_revocation_list_has_expired(tmp_path: Path, version: ssl.TLSVersion) -> None:
    folder, context = pki(), client_context(OPERATOR)
    context.maximum_version = version
    (tmp_path / "settings").write_text(
        f"[ca]\ndefault_ca=o\n[o]\ndatabase={folder}/ca.index\ncertificate={folder}/ca.crt\n"
        f"private_key={folder}/ca.key\ndefault_md=sha256\n"
    )
    shutil.copy(folder / "ca.crl", tmp_path)
    config = listener() + IMAGE + ROWS
    with GatewayProcess(tmp_path, config.replace(f"{folder}/ca.crl", f"{tmp_path}/ca.crl")) as gateway:
        for seconds in (4, 20, 60):  # a machine may be so busy that a list expires before it is used
            crl = "-gencrl", "-crlsec", seconds, "-out", tmp_path / "ca.crl"
            openssl("ca", "-config", tmp_path / "settings", *crl)
            gateway.signal(signal.SIGHUP)
            gateway.wait_for("config_applied")
            if resumed := connect_until_refused(gateway.port, context):
                break
        assert resumed
        assert reason(gateway) in ("its certificate is refused: CRL has expired", OUTLIVED)  # it may expire just then


def connect_until_refused(port: int, context: ssl.SSLContext) -> int:
    """How often a session was resumed by a client that connects again and again."""
    session, resumed, end = None, 0, time.monotonic() + 2 * PATIENCE
    with suppress(ssl.SSLError, ConnectionError):
        while time.monotonic() < end:
            plain = from_address("127.0.0.1", port)
            with plain, context.wrap_socket(plain, server_hostname="localhost", session=session) as client:
                if not asks(client, READ):
                    break
                resumed += client.session_reused
                session = client.session
            time.sleep(0.05)
    return resumed


def test_an_authority_that_trusts_nobody_is_told_at_the_start_and_at_a_reload(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki(), folder)
    other = tmp_path / "other"
    assert command("certificates", "authority", "--name", "other", "--folder", str(other)).returncode == 0
    (folder / "ca.crt").write_text((folder / "ca.crt").read_text() + (other / "ca.crt").read_text())
    config = (listener() + IMAGE + ROWS).replace(str(pki()), str(folder))
    said = f"listen remote: {folder}/ca.crl: has no revocation list of CN=other, only of CN=Plant 2"
    with GatewayProcess(tmp_path, config) as gateway:
        assert [each for each in gateway.log if said in each.get("problem", "")]
        assert told(gateway.port, OPERATOR) == WRITE.hex()
        gateway.signal(signal.SIGHUP)
        assert said in gateway.wait_for("config_warning")["problem"]
        assert said in command("check", str(gateway.config)).stdout


def test_a_certificate_of_a_server_is_none_of_a_client(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        assert told(gateway.port, "server") in (
            "SSLV3_ALERT_UNSUPPORTED_CERTIFICATE",
            "TLSV1_ALERT_UNKNOWN_CA",
            "closed",
        )
        assert "purpose" in reason(gateway)


def test_what_is_not_tls_is_closed(tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        for number, sent in enumerate((encode(1, 200, READ), b"GET / HTTP/1.1\r\n\r\n", bytes(11)), 2):
            with from_address(f"127.0.0.{number}", gateway.port) as client:
                client.sendall(sent)
                assert client.recv(260)[7:] == b""
            assert reason(gateway) == "what it sends is not TLS"


def test_old_versions_and_weak_suites_are_refused(tmp_path: Path) -> None:
    folder = pki()
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway:
        words = ["openssl", "s_client", "-connect", f"127.0.0.1:{gateway.port}", "-cert", f"{folder}/operator.crt"]
        words += ["-key", f"{folder}/operator.key", "-CAfile", f"{folder}/ca.crt"]
        for options in (
            ["-tls1_1", "-cipher", "ALL:@SECLEVEL=0"],
            ["-tls1", "-cipher", "ALL:@SECLEVEL=0"],
            ["-tls1_2", "-cipher", "ECDHE-ECDSA-AES128-SHA"],
            ["-tls1_2", "-cipher", "AES128-SHA256"],
            ["-tls1_2", "-cipher", "NULL-SHA256:@SECLEVEL=0"],
        ):
            done = subprocess.run(
                [*words, *options], input="", capture_output=True, text=True, timeout=PATIENCE, check=False
            )
            assert "Cipher is (NONE)" in done.stdout, options


def test_openssl_is_a_client(gateway: GatewayProcess) -> None:
    folder = pki()
    words = ["openssl", "s_client", "-quiet", "-connect", f"127.0.0.1:{gateway.port}", "-CAfile", f"{folder}/ca.crt"]
    words += ["-cert", f"{folder}/operator.crt", "-key", f"{folder}/operator.key", "-verify_return_error"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as client:
        assert client.stdin is not None
        assert client.stdout is not None
        client.stdin.write(encode(7, 200, READ))
        client.stdin.flush()
        answer = client.stdout.read(11)
        client.stdin.close()
        client.kill()
    assert answer[:2] == b"\x00\x07"
    assert answer[7:9] == b"\x03\x02"


def test_renegotiation_is_refused(gateway: GatewayProcess) -> None:
    folder = pki()
    words = ["openssl", "s_client", "-connect", f"127.0.0.1:{gateway.port}", "-CAfile", f"{folder}/ca.crt", "-tls1_2"]
    words += ["-cert", f"{folder}/operator.crt", "-key", f"{folder}/operator.key"]
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as client:
        assert client.stdin is not None
        assert client.stdout is not None
        while "Verify return code" not in (line := client.stdout.readline()):
            assert line
        client.stdin.write("R\n")
        client.stdin.flush()
        said = ""
        while line := client.stdout.readline():
            said += line
            if "error" in line:
                break
        client.kill()
    assert "no renegotiation" in said


def test_who_only_changes_keys_is_disconnected(tmp_path: Path) -> None:
    """Each KeyUpdate costs the gateway more than the client, in the event loop."""
    with GatewayProcess(tmp_path, listener() + IMAGE) as gateway, key_updater(gateway.port, OPERATOR) as updater:
        for _ in range(50):  # now and then is fine
            assert updater.update(5)
            updater.send(encode(1, 200, READ))
            assert updater.receive()[7:].hex() == "03020000"
        sent = 0
        while updater.update(1):
            sent += 1
            assert sent < 100_000
        assert reason(gateway) == TOO_MUCH_BESIDE_DATA


def test_pymodbus_is_a_client(gateway: GatewayProcess) -> None:
    context = client_context(OPERATOR)
    context.check_hostname = False  # it has no way to name the server
    client = ModbusTlsClient("127.0.0.1", port=gateway.port, sslctx=context, timeout=PATIENCE)
    assert client.connect()
    try:
        assert not client.write_register(4, 4999, device_id=200).isError()
        assert client.read_holding_registers(4, count=2, device_id=200).registers == [4999, 0]
    finally:
        client.close()


def test_requests_that_are_pipelined_and_cut_anywhere_all_get_their_answers(gateway: GatewayProcess) -> None:
    asked = b"".join(encode(number, 200, READ) for number in range(1000))
    with connected(gateway.port, client_context(OPERATOR)) as client:
        client.settimeout(PATIENCE)
        sent, got = 0, b""
        while sent < len(asked):
            step = 1 + sent % 700
            client.sendall(asked[sent : sent + step])
            sent += step
        while len(got) < 1000 * 11:
            got += client.recv(65536)
    assert [int.from_bytes(got[at : at + 2]) for at in range(0, len(got), 11)] == list(range(1000))


def test_who_has_said_that_it_sends_no_more_still_gets_its_answers(gateway: GatewayProcess) -> None:
    with connected(gateway.port, client_context(OPERATOR)) as client:
        client.sendall(encode(1, 200, READ))
        socket.socket.shutdown(client, socket.SHUT_WR)
        assert client.recv(260)[7:9] == b"\x03\x02"
        assert client.recv(260) == b""


@pytest.mark.parametrize("own", ["127.0.0.1", "127.0.0.2"])
def test_sixty_silent_connections_of_one_address_keep_nobody_out(tmp_path: Path, own: str) -> None:
    """Not even clients of this address: a plain host behind the same router is one."""
    with GatewayProcess(tmp_path, listener() + IMAGE + ROWS) as gateway, ExitStack() as silent:
        for _ in range(60):
            silent.enter_context(from_address("127.0.0.2", gateway.port))
        assert told(gateway.port, OPERATOR, own=own) == WRITE.hex()


@pytest.mark.parametrize("addresses", [1, 100])
def test_silent_connections_make_room_after_a_second_however_many_there_are(tmp_path: Path, addresses: int) -> None:
    with GatewayProcess(tmp_path, listener() + IMAGE + ROWS) as gateway, ExitStack() as opened:
        silent = [
            opened.enter_context(from_address(f"127.0.0.{2 + number % addresses}", gateway.port))
            for number in range(100)
        ]
        end = time.monotonic() + PATIENCE
        while len(select.select(silent, [], [], 0)[0]) < len(silent) - MOST:  # until the others were turned away
            assert time.monotonic() < end
            time.sleep(0.02)
        assert reason(gateway) in (TOO_MANY, MADE_ROOM)  # on a busy machine it takes more than a second
        time.sleep(SLOW)
        assert told(gateway.port, OPERATOR, own="127.0.0.2") == WRITE.hex()


def from_address(own: str, port: int) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port), PATIENCE, (own, 0))


def test_certificates_change_by_reload(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki(), folder)
    config = (listener() + IMAGE + ROWS).replace(str(pki()), str(folder))
    with GatewayProcess(tmp_path, config) as gateway:
        before = serial_of(gateway.port)
        with connected(gateway.port, client_context(OPERATOR)) as kept:
            assert command(
                "certificates", "server", "localhost", "127.0.0.1", "--replace", "--folder", str(folder)
            ).returncode == 0  # fmt: skip
            gateway.signal(signal.SIGHUP)
            gateway.wait_for("config_applied")
            assert serial_of(gateway.port) != before
            assert asks(kept, READ).startswith("0302")  # nothing about who is trusted has changed
            assert command("certificates", "revoke", f"{folder}/operator.crt", "--folder", str(folder)).returncode == 0
            gateway.signal(signal.SIGHUP)
            gateway.wait_for("config_applied")
            assert kept.recv(1) == b""
        assert told(gateway.port, OPERATOR) in ("SSLV3_ALERT_CERTIFICATE_REVOKED", "closed")
        (folder / "server.key").write_text("broken")
        gateway.signal(signal.SIGHUP)
        assert "server.key: this is no private key" in gateway.wait_for("config_rejected")["reason"]
        with connected(gateway.port, client_context(VIEWER)) as client:
            assert asks(client, READ).startswith("0302")


def serial_of(port: int) -> str:
    with connected(port, client_context(VIEWER)) as client:
        return client.getpeercert()["serialNumber"]


@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda folder: (folder / "server.key").chmod(0o644), "others may read or change it; chmod o=,g-w"),
        (lambda folder: (folder / "server.key").unlink(), "no such file or directory"),
        (
            lambda folder: shutil.copy(folder / "viewer.key", folder / "server.key"),
            "does not belong to the certificate",
        ),
        (lambda folder: (folder / "server.crt").write_text("none"), "has no CERTIFICATE in PEM form"),
        (lambda folder: shutil.copy(folder / "viewer.crt", folder / "ca.crt"), "has no certificate of an authority"),
        (lambda folder: shutil.copy(folder / "ca.crt", folder / "ca.crl"), "has no X509 CRL in PEM form"),
    ],
)
def test_files_that_cannot_be_used_are_told_and_nothing_starts(tmp_path: Path, spoil, why: str) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki(), folder)
    spoil(folder)
    config = tmp_path / "gateway.toml"
    config.write_text((listener() + IMAGE).replace(str(pki()), str(folder)))
    done = command("run", str(config))
    assert done.returncode == 1
    assert why in done.stderr
    assert "gateway.toml:1: " in done.stderr
    assert "Traceback" not in done.stderr
    key = (pki() / "server.key").read_text().splitlines()[1]
    assert key not in done.stderr + done.stdout


def test_no_core_is_dumped_when_it_was_started_by_hand(tmp_path: Path) -> None:
    config = tmp_path / "gateway.toml"
    config.write_text(listener() + IMAGE)
    shell = f'ulimit -Sc unlimited; exec {" ".join(COMMAND)} run "{config}"'
    own = {**os.environ, "RUNTIME_DIRECTORY": str(tmp_path), "STATE_DIRECTORY": str(tmp_path)}
    with subprocess.Popen(["sh", "-c", shell], stderr=subprocess.PIPE, text=True, env=own) as gateway:
        try:
            while "listener_up" not in (line := gateway.stderr.readline()):
                assert line
            limits = Path(f"/proc/{gateway.pid}/limits").read_text()
        finally:
            gateway.kill()
    assert limits.partition("Max core file size")[2].split()[0] == "0"


def test_no_secret_is_told(tmp_path: Path) -> None:
    secrets = [line for file in pki().glob("*.key") for line in file.read_text().splitlines()[1:-1]]
    with GatewayProcess(tmp_path, listener() + IMAGE + ROWS + f'[control]\nsocket = "{tmp_path}/c"\n') as gateway:
        said = [command(verb, *words, "--control", f"{tmp_path}/c", "--json").stdout for verb, *words in (["status"],)]
        said += [command("check", str(gateway.config)).stdout, str(gateway.log)]
        assert not [secret for secret in secrets if any(secret in each for each in said)]
    assert all(said)


# --- the gateway as a client ---


def upstream(port: int, name: str = OPERATOR, **changes: str) -> str:
    folder = pki()
    keys = {
        "certificate": f"{folder}/{name}.crt",
        "key": f"{folder}/{name}.key",
        "ca": f"{folder}/ca.crt",
        "server_name": "localhost",
        **changes,
    }
    lines = "\n".join(f'{key} = "{value}"' for key, value in keys.items())
    return (
        f'[[listen]]\nbind = "tcp://127.0.0.1:0"\n[[upstream]]\nname = "far"\nto = "tls://127.0.0.1:{port}"\n'
        f'timeout = "20 s"\nunits = [{{ as = 37, unit = 200 }}]\n{lines}\n'
    )


def test_units_behind_a_secured_server(gateway: GatewayProcess, tmp_path: Path) -> None:
    with GatewayProcess(tmp_path, upstream(gateway.port)) as near, from_address("127.0.0.1", near.port) as client:
        near.first("line_up")
        client.sendall(encode(1, 37, WRITE))
        assert client.recv(260)[7:] == WRITE
        client.sendall(encode(2, 37, READ))
        assert client.recv(260)[7:] == bytes.fromhex("03020007")


@pytest.mark.parametrize(
    ("name", "changes", "why"),
    [
        (OPERATOR, {"server_name": "elsewhere"}, "certificate is refused: Hostname mismatch"),
        ("revoked", {}, "it says that the certificate here is revoked"),
    ],
)
def test_a_server_that_cannot_be_trusted_or_does_not_trust_us(
    gateway: GatewayProcess, tmp_path: Path, name: str, changes: dict[str, str], why: str
) -> None:
    with GatewayProcess(tmp_path, upstream(gateway.port, name, **changes)) as near:
        lost = near.first("line_lost")
        assert "TLS failed" in lost["reason"]
        assert why in lost["reason"]
        with socket.create_connection(("127.0.0.1", near.port), PATIENCE) as client:
            client.sendall(encode(1, 37, READ))
            assert client.recv(260)[7:].hex() == "830a"


class Listener:
    """Who uses a port, and notes what it hears, and when it is lost."""

    def __init__(self) -> None:
        self.heard = b""
        self.hears = asyncio.Event()
        self.losses: list[PortError] = []

    def received(self, data: bytes) -> None:
        """See PortUser."""
        self.heard += data
        self.hears.set()

    def lost(self, reason: PortError) -> None:
        """See PortUser."""
        self.losses.append(reason)


@asynccontextmanager
async def secured(user: Listener) -> AsyncIterator[tuple[Port, ssl.SSLSocket]]:
    """A port to a server in this process, and the server's end of it."""
    folder = pki()
    files = (SecretFile(str(folder / name)) for name in ("operator.crt", "operator.key", "ca.crt"))
    tls = ClientTls(*files, "localhost")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "server.crt", folder / "server.key")
    with socket.create_server(("127.0.0.1", 0)) as listening, ThreadPoolExecutor(1) as pool:

        def serve() -> socket.socket:
            plain, _ = listening.accept()
            return context.wrap_socket(plain, server_side=True)

        served = pool.submit(serve)
        number = listening.getsockname()[1]
        settings = TcpSettings(f"tls://127.0.0.1:{number}", "127.0.0.1", number, tls=tls)
        port = await open_tcp(settings, user, load(tls).context)
        with served.result(PATIENCE) as far_end:
            yield port, far_end
            port.close()
            async with asyncio.timeout(20):  # asyncio itself waits for 30 s
                await port.wait_closed()


async def test_a_server_that_does_not_answer_the_end_of_tls_is_not_waited_for() -> None:
    async with secured(Listener()):
        pass


@pytest.mark.parametrize("says", [b"", b"an answer that comes too late"])
async def test_a_connection_that_the_gateway_has_closed_is_no_loss_whatever_the_server_does(says: bytes) -> None:
    user = Listener()
    async with secured(user) as (port, far_end):
        port.close()
        if says:
            far_end.sendall(says)
        began = asyncio.get_running_loop().time()
        await asyncio.wait_for(port.wait_closed(), PATIENCE)
        assert asyncio.get_running_loop().time() - began < 0.9
    assert ([type(loss) for loss in user.losses], user.heard) == ([PortClosed], b"")


@pytest.mark.parametrize("end", ["in order", "reset", "something"])
async def test_who_looks_before_asking_learns_that_the_server_has_ended_the_connection(end: str) -> None:
    """The gateway has not read yet, and what has come is secured."""
    user = Listener()
    async with secured(user) as (port, far_end):
        port.read_now()
        assert user.losses == []
        far_end.sendall(b"answer")
        await asyncio.wait_for(user.hears.wait(), PATIENCE)
        port.read_now()
        assert user.losses == []
        if end == "something":
            far_end.sendall(b"nobody has asked for this")
        else:
            if end == "in order":
                with suppress(OSError):
                    far_end.setblocking(False)
                    far_end.unwrap()
            far_end.close()
        select.select([port._descriptor], [], [], PATIENCE)
        port.read_now()
        assert [type(loss) for loss in user.losses] == [ConnectionEnded]
        port.read_now()
        await asyncio.wait_for(port.wait_closed(), PATIENCE)
    assert (len(user.losses), user.heard) == (1, b"answer")


# --- the web page ---


def test_the_certificate_of_the_page_changes_by_reload(tmp_path: Path) -> None:
    folder = tmp_path / "tls"
    shutil.copytree(pki(), folder)
    web = f'[web]\nbind = "https://127.0.0.1:0"\ncertificate = "{folder}/server.crt"\nkey = "{folder}/server.key"\n'
    with GatewayProcess(tmp_path, IMAGE + '[[listen]]\nbind = "tcp://127.0.0.1:0"\n' + web) as gateway:
        address = next(each["address"] for each in gateway.log if each["event"] == "web_up")
        port = int(address.rpartition(":")[2])
        before = shown(port)
        replace = ["certificates", "server", "localhost", "127.0.0.1", "--replace", "--folder", str(folder)]
        assert command(*replace).returncode == 0
        gateway.signal(signal.SIGHUP)
        gateway.wait_for("config_applied")
        assert shown(port) != before
        assert shown(port, name="127.0.0.1") == shown(port)


def test_the_page_keeps_its_certificate_until_a_restart_if_another_file_is_named(tmp_path: Path) -> None:
    folder = pki()
    web = f'[web]\nbind = "https://127.0.0.1:0"\ncertificate = "{folder}/server.crt"\nkey = "{folder}/server.key"\n'
    with GatewayProcess(tmp_path, IMAGE + '[[listen]]\nbind = "tcp://127.0.0.1:0"\n' + web) as gateway:
        address = next(each["address"] for each in gateway.log if each["event"] == "web_up")
        port = int(address.rpartition(":")[2])
        before = shown(port)
        for file in ("server.crt", "server.key"):
            shutil.copy(folder / file, tmp_path / file)
        gateway.config.write_text(gateway.config.read_text().replace(f"{folder}/server", f"{tmp_path}/server"))
        gateway.signal(signal.SIGHUP)
        assert gateway.wait_for("config_applied")["restart"] == ["web"]
        assert shown(port) == before


def shown(port: int, name: str = "localhost") -> bytes:
    """The certificate that a browser gets, if it trusts it."""
    context = ssl.create_default_context(cafile=str(pki() / "ca.crt"))
    plain = from_address("127.0.0.1", port)
    with plain, context.wrap_socket(plain, server_hostname=name) as client:
        client.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert client.recv(100).startswith(b"HTTP/1.1 200 OK")
        return client.getpeercert(binary_form=True) or b""


def test_the_demo_can_be_tried_with_certificates(tmp_path: Path) -> None:
    words = [*COMMAND, "demo", "--tls"]
    own = {**os.environ, "RUNTIME_DIRECTORY": str(tmp_path), "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=own) as demo:
        try:
            said = ""
            while "-key " not in said:
                line = demo.stdout.readline()
                assert line, said
                said += line
            folder = Path(said.rpartition("-CAfile ")[2].partition("/ca.crt")[0])
            port = int(said.rpartition("tls://127.0.0.1:")[2].partition(".")[0])
            context = ssl.create_default_context(cafile=str(folder / "ca.crt"))
            context.load_cert_chain(folder / "viewer.crt", folder / "viewer.key")
            with connected(port, context) as client:
                client.sendall(encode(1, 200, READ))
                assert client.recv(260)[7] == 3
                client.sendall(encode(2, 200, WRITE))
                assert client.recv(260)[7:].hex() == "8601"
        finally:
            demo.terminate()
            demo.wait(PATIENCE)
    assert not folder.exists()
