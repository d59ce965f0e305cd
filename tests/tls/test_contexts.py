"""Whom a context trusts: the chain of a client's certificate; and what is said of files that trust nobody."""

import os
import re
import ssl
import time
from dataclasses import replace
from math import inf
from pathlib import Path

import pytest

from gateway.errors import TlsError
from gateway.tls.contexts import Loaded, load, stop_resuming
from gateway.tls.files import LARGEST_FILE
from gateway.tls.settings import ClientTls, SecretFile, ServerTls
from kit.pki import OPERATOR, client_context, openssl, pki

_EXTENSIONS = (
    "[ca]\nbasicConstraints=critical,CA:TRUE\nkeyUsage=keyCertSign,cRLSign\n[end]\nbasicConstraints=CA:FALSE\n"
)


def make(folder: Path, name: str, issuer: str, kind: str) -> None:
    """A certificate of `issuer`, and its key."""
    (folder / "extensions").write_text(_EXTENSIONS)
    key, request, made = (folder / f"{name}.{end}" for end in ("key", "csr", "crt"))
    new_key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-subj", f"/CN={name}")
    openssl("req", *new_key, "-keyout", key, "-out", request)
    ca = ("-CA", folder / f"{issuer}.crt", "-CAkey", folder / f"{issuer}.key", "-CAcreateserial")
    signer = ca if issuer != name else ("-signkey", key)
    more = ("-extfile", folder / "extensions", "-extensions", kind, "-days", "2")
    openssl("x509", "-req", "-in", request, *signer, *more, "-out", made)


def make_list(folder: Path, issuer: str, *revoked: str) -> str:
    """The revocation list of `issuer`."""
    (folder / f"{issuer}.index").write_text("")
    settings = folder / f"{issuer}.settings"
    settings.write_text(
        f"[ca]\ndefault_ca=o\n[o]\ndatabase={folder}/{issuer}.index\ncertificate={folder}/{issuer}.crt\n"
        f"private_key={folder}/{issuer}.key\ndefault_md=sha256\ndefault_crl_days=2\n"
    )
    for name in revoked:
        openssl("ca", "-config", settings, "-revoke", folder / f"{name}.crt")
    return openssl("ca", "-config", settings, "-gencrl")


@pytest.mark.parametrize(("revoked", "why"), [((), ""), (("plant",), "certificate revoked")])
def test_a_client_of_an_authority_that_is_revoked_is_refused(
    tmp_path: Path, revoked: tuple[str, ...], why: str
) -> None:
    for name, issuer, kind in (("root", "root", "ca"), ("plant", "root", "ca"), ("hmi", "plant", "end")):
        make(tmp_path, name, issuer, kind)
    (tmp_path / "lists").write_text(make_list(tmp_path, "root", *revoked) + make_list(tmp_path, "plant"))
    chain = tmp_path / "chain.crt"
    chain.write_text((tmp_path / "hmi.crt").read_text() + (tmp_path / "plant.crt").read_text())
    server = served(tmp_path / "root.crt", tmp_path / "lists").context
    assert refusal(server, chain, tmp_path / "hmi.key") == why


def files(clients_ca: Path | None = None, crl: Path | None = None) -> ServerTls:
    """Those of a listener."""
    folder = pki()
    certificate, key = (SecretFile(str(folder / f"server.{end}")) for end in ("crt", "key"))
    trusted = SecretFile(str(clients_ca or folder / "ca.crt"))
    return ServerTls(certificate, key, trusted, None if crl is None else SecretFile(str(crl)))


def served(clients_ca: Path | None = None, crl: Path | None = None) -> Loaded:
    """What a listener has loaded."""
    return load(files(clients_ca, crl))


def text(*files: Path) -> str:
    return "".join(file.read_text() for file in files)


@pytest.fixture(scope="module")
def plants(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Authorities: `plant` is of `root`; `other`. Each has a revocation list."""
    folder = tmp_path_factory.mktemp("plants")
    for name, issuer in (("root", "root"), ("plant", "root"), ("other", "other")):
        make(folder, name, issuer, "ca")
    for name in ("root", "plant", "other"):
        (folder / f"{name}.crl").write_text(make_list(folder, name))
    return folder


# --- authorities and lists that let nobody in ---


def test_an_authority_without_the_one_that_has_signed_it_lets_nobody_in(plants: Path, tmp_path: Path) -> None:
    missing = "CN=plant is an authority that CN=root has signed, whose certificate is missing"
    with pytest.raises(TlsError, match=rf"plant\.crt: {missing}.*nobody would be trusted"):
        served(plants / "plant.crt")
    own = (SecretFile(str(pki() / f"operator.{end}")) for end in ("crt", "key"))
    with pytest.raises(TlsError, match=missing):
        load(ClientTls(*own, SecretFile(str(plants / "plant.crt")), "localhost"))
    both = tmp_path / "both.crt"
    both.write_text(text(plants / "plant.crt", plants / "other.crt"))
    (said,) = served(both).warnings
    assert missing in said
    both.write_text(text(plants / "plant.crt", plants / "root.crt"))
    assert served(both).warnings == ()


def test_a_list_of_another_authority_lets_nobody_in(plants: Path, tmp_path: Path) -> None:
    missing = "has no revocation list of CN=root, only of CN=other"
    with pytest.raises(TlsError, match=rf"other\.crl: {missing}.*nobody would be trusted"):
        served(plants / "root.crt", plants / "other.crl")
    with pytest.raises(TlsError, match=r"no revocation list of CN=root, only of CN=plant"):
        served(plants / "root.crt", plants / "plant.crl")
    both = tmp_path / "both.crt"
    both.write_text(text(plants / "root.crt", plants / "other.crt"))
    (said,) = served(both, plants / "other.crl").warnings
    assert missing in said
    lists = tmp_path / "lists.crl"
    lists.write_text(text(plants / "root.crl", plants / "plant.crl", plants / "other.crl"))
    assert served(both, lists).warnings == ()


# --- files with something else in them ---


@pytest.mark.parametrize("kind", ["CERTIFICATE", "X509 CERTIFICATE", "TRUSTED CERTIFICATE"])
def test_a_file_of_lists_adds_no_authorities(plants: Path, tmp_path: Path, kind: str) -> None:
    lists = tmp_path / "lists.crl"
    lists.write_text(text(pki() / "ca.crl", plants / "other.crt").replace("CERTIFICATE", kind))
    with pytest.raises(TlsError, match=r"lists\.crl: has certificates too"):
        served(crl=lists)


def test_a_file_of_authorities_has_no_lists(tmp_path: Path) -> None:
    """Nobody would look at them without the key crl."""
    both = tmp_path / "ca.crt"
    both.write_text(text(pki() / "ca.crt", pki() / "ca.crl"))
    with pytest.raises(TlsError, match=r"ca\.crt: has revocation lists: name their file by crl"):
        served(both)


@pytest.mark.parametrize("which", ["certificate", "key", "clients_ca", "crl"])
def test_a_file_that_is_too_large_or_no_file_is_told(tmp_path: Path, which: str) -> None:
    file, all_files = tmp_path / "file", files(crl=pki() / "ca.crl")
    os.mkfifo(file, 0o600)
    with pytest.raises(TlsError, match="file: is not a regular file"):
        load(replace(all_files, **{which: SecretFile(str(file))}))
    with pytest.raises(TlsError, match=f"{tmp_path}: is not a regular file"):
        load(replace(all_files, **{which: SecretFile(str(tmp_path))}))
    if which == "key":
        return  # OpenSSL reads it itself, and stops behind the key
    usual = {"certificate": "server.crt", "clients_ca": "ca.crt", "crl": "ca.crl"}[which]
    file.unlink()
    file.write_text(LARGEST_FILE * " " + "\n" + text(pki() / usual))
    with pytest.raises(TlsError, match=f"has more than {LARGEST_FILE} bytes"):
        load(replace(all_files, **{which: SecretFile(str(file))}))


@pytest.mark.parametrize("options", [("-aes256",), ("-traditional", "-aes256"), ("-aes256", "-topk8")])
def test_an_encrypted_key_is_told_apart_from_a_damaged_one(tmp_path: Path, options: tuple[str, ...]) -> None:
    key = tmp_path / "server.key"
    program = ("pkcs8", "-topk8", "-v2", "aes256") if "-topk8" in options else ("pkey", *options)
    openssl(*program, "-in", pki() / "server.key", "-passout", "pass:secret", "-out", key)
    key.chmod(0o600)
    with pytest.raises(TlsError, match=r"server\.key: this key is encrypted; the gateway needs one without"):
        load(replace(files(), key=SecretFile(str(key))))


# --- sessions that are resumed ---


def test_sessions_are_not_resumed_when_an_authority_or_a_list_has_expired(plants: Path) -> None:
    assert served().resumable_until == pytest.approx(time.time() + 3650 * 86400, abs=3600)
    lists = served(plants / "root.crt", plants / "root.crl")
    assert lists.resumable_until == pytest.approx(time.time() + 2 * 86400, abs=3600)
    assert load(ServerTls(*(SecretFile(str(pki() / f"server.{end}")) for end in ("crt", "key")))).resumable_until == inf


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
def test_a_context_that_has_stopped_resuming_makes_whole_handshakes(version: ssl.TLSVersion) -> None:
    server, client = served().context, client_context(OPERATOR)
    client.maximum_version = version
    first = connect(client, server)
    assert not first.session_reused
    again = connect(client, server, first.session)
    assert again.session_reused
    stop_resuming(server)
    assert not connect(client, server, again.session).session_reused


def connect(client: ssl.SSLContext, server: ssl.SSLContext, session: ssl.SSLSession | None = None) -> ssl.SSLObject:
    """The client's end, when it has got something."""
    first, second = ssl.MemoryBIO(), ssl.MemoryBIO()
    near = client.wrap_bio(first, second, server_hostname="localhost", session=session)
    far = server.wrap_bio(second, first, server_side=True)
    done: set[ssl.SSLObject] = set()
    while len(done) < 2:
        for end in (near, far):
            try:
                end.do_handshake()
                done.add(end)
            except ssl.SSLWantReadError:
                continue
    far.write(b"!")
    assert near.read(1) == b"!"
    return near


def refusal(server: ssl.SSLContext, certificate: Path, key: Path) -> str:
    """Why a client with this certificate is refused; empty if it is not."""
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.load_verify_locations(pki() / "ca.crt")
    client.load_cert_chain(certificate, key)
    first, second = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = (
        client.wrap_bio(first, second, server_hostname="localhost"),
        server.wrap_bio(second, first, server_side=True),
    )
    done = set()
    while len(done) < len(ends):
        for end in ends:
            try:
                end.do_handshake()
                done.add(end)
            except ssl.SSLWantReadError:
                continue
            except ssl.SSLCertVerificationError as error:
                return error.verify_message
    return ""


@pytest.mark.parametrize("which", ["certificate", "clients_ca", "crl"])
def test_a_file_that_is_not_valid_yet_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, which: str) -> None:
    folder = pki()
    files = {"certificate": "server.crt", "clients_ca": "ca.crt", "crl": "ca.crl"}
    settings = ServerTls(*(SecretFile(str(folder / name)) for name in ("server.crt", "server.key", "ca.crt", "ca.crl")))
    assert load(settings).warnings == ()
    monkeypatch.setattr(time, "time", lambda: 1_600_000_000.0)
    (said,) = (each for each in load(settings).warnings if files[which] in each)
    early = rf"{folder / files[which]} is not valid before 20..-..-.. ..:.. UTC"
    assert re.fullmatch(rf"{early}, and the clock here says 2020-09-13 12:26 UTC", said)
