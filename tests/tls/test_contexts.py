"""Whom a context trusts: the chain of a client's certificate."""

import ssl
from pathlib import Path

import pytest

from gateway.tls.contexts import load
from gateway.tls.secret_file import SecretFile
from gateway.tls.settings import ServerTls
from kit.pki import openssl, pki

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
    own = (SecretFile(str(pki() / "server.crt")), SecretFile(str(pki() / "server.key")))
    server = load(ServerTls(*own, SecretFile(str(tmp_path / "root.crt")), SecretFile(str(tmp_path / "lists")))).context
    assert refusal(server, chain, tmp_path / "hmi.key") == why


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
