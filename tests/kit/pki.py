"""Certificates for tests: an authority, servers, and clients of every kind."""

import ssl
import subprocess
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

from gateway.tls import making
from gateway.tls.certificate import ROLE
from gateway.tls.der import SEQUENCE, elements, only
from gateway.tls.revoking import revoke
from kit.left_out import need

OPERATOR, VIEWER = "operator", "viewer"
#: In the settings of openssl: extensions with more than one role, and with one that is no UTF8String.
TWO_ROLES = f"{ROLE}=ASN1:UTF8String:operator\n{ROLE[:-1]}2=ASN1:UTF8String:viewer"  # see signed
WRONG_TEXT = f"{ROLE}=ASN1:PRINTABLESTRING:operator"
NOT_UTF8 = f"{ROLE}=DER:0c:02:c3:28"


@lru_cache(maxsize=1)
def pki() -> Path:
    """A folder with an authority (`ca`), `server`, and the clients `operator`, `viewer`, `nobody` and `revoked`."""
    need("openssl")
    folder = Path(mkdtemp(prefix="pki-"))
    making.make_authority(folder, "Plant 2")
    making.make_server(folder, "server", ["localhost", "127.0.0.1", "::1"])
    making.make_client(folder, OPERATOR, OPERATOR)
    making.make_client(folder, VIEWER, VIEWER)
    making.make_client(folder, "nobody")
    making.make_client(folder, "revoked", OPERATOR)
    revoke(folder, [folder / "revoked.crt"])
    return folder


def signed(folder: Path, name: str, extensions: str = "", *, days: str = "2", at: str = "") -> Path:
    """A client's certificate of the authority in `pki()` with these extensions, put into `folder`.

    `at` is when it is valid, if that is not from now on: `-startdate 20200101000000Z -enddate 20200102000000Z`.
    """
    settings = folder / f"{name}.settings"
    settings.write_text(
        f"[req]\nprompt=no\ndistinguished_name=s\n[s]\nCN={name}\n[e]\nbasicConstraints=CA:FALSE\n{extensions}\n"
    )
    key, request, certificate = (folder / f"{name}.{end}" for end in ("key", "csr", "crt"))
    new_key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"]
    openssl("req", *new_key, "-config", settings, "-keyout", key, "-out", request)
    ca = pki()
    (folder / "index").write_text("")
    whole = folder / f"{name}.ca"
    whole.write_text(
        f"[ca]\ndefault_ca=own\n[own]\ndatabase={folder / 'index'}\nnew_certs_dir={folder}\nrand_serial=yes\n"
        f"certificate={ca / 'ca.crt'}\nprivate_key={ca / 'ca.key'}\ndefault_md=sha256\npolicy=any\nunique_subject=no\n"
        "[any]\ncommonName=supplied\n"
    )
    dates = at.split() or ["-days", days]
    openssl(
        "ca", "-batch", "-config", whole, "-in", request, "-out", certificate, "-extfile", settings, "-extensions", "e",
        "-notext", *dates,
    )  # fmt: skip
    if extensions == TWO_ROLES:
        _change(certificate, bytes.fromhex("2b0601040183890c862202"), bytes.fromhex("2b0601040183890c862201"))
    return certificate


def _change(certificate: Path, old: bytes, new: bytes) -> None:
    """Change something in a certificate, which openssl would not write so, and sign it again."""
    outer = only(der(certificate), SEQUENCE)
    (_, content), (_, algorithm), _ = elements(outer)
    signed_part = certificate.with_suffix(".tbs")
    signed_part.write_bytes(_sequence(content.replace(old, new)))
    signature = certificate.with_suffix(".sig")
    openssl("dgst", "-sha256", "-sign", pki() / "ca.key", "-out", signature, signed_part)
    bits = b"\0" + signature.read_bytes()
    whole = _sequence(signed_part.read_bytes() + _sequence(algorithm) + bytes((0x03, len(bits))) + bits)
    certificate.write_text(ssl.DER_cert_to_PEM_cert(whole))


def _sequence(content: bytes) -> bytes:
    length = len(content)
    if length < 0x80:
        return bytes((SEQUENCE, length)) + content
    return bytes((SEQUENCE, 0x82)) + length.to_bytes(2) + content


def openssl(*words: object) -> str:
    """What `openssl WORDS` prints; without that program the test is left out."""
    need("openssl")
    done = subprocess.run(["openssl", *map(str, words)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def der(file: Path) -> bytes:
    return ssl.PEM_cert_to_DER_cert(file.read_text())


def client_context(name: str = "", folder: Path | None = None) -> ssl.SSLContext:
    """Of a client that trusts the authority and shows the certificate `name`, none if it is empty."""
    context = ssl.create_default_context(cafile=str(pki() / "ca.crt"))
    if name:
        of = folder or pki()
        context.load_cert_chain(of / f"{name}.crt", of / f"{name}.key")
    return context


def handshake_without_tickets(server: ssl.SSLContext) -> None:
    """Connect a client of TLS 1.2 that takes no tickets, in memory: `server` keeps its session."""
    incoming, outgoing, client = ssl.MemoryBIO(), ssl.MemoryBIO(), client_context(OPERATOR)
    client.maximum_version = ssl.TLSVersion.TLSv1_2
    client.options |= ssl.OP_NO_TICKET
    ends = (
        client.wrap_bio(incoming, outgoing, server_hostname="localhost"),
        server.wrap_bio(outgoing, incoming, server_side=True),
    )
    for _ in range(3):
        for end in ends:
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
    assert ends[1].version() == "TLSv1.2"
    with suppress(ssl.SSLWantReadError):
        ends[1].unwrap()  # else the session is forgotten at once


def listener(extra: str = "", *, bind: str = "tls://127.0.0.1:0", name: str = "remote", crl: bool = True) -> str:
    """A `[[listen]]` table with the certificates of the folder."""
    folder = pki()
    revoked = f'crl = "{folder}/ca.crl"\n' if crl else ""
    return (
        f'[[listen]]\nname = "{name}"\nbind = "{bind}"\ncertificate = "{folder}/server.crt"\n'
        f'key = "{folder}/server.key"\nclients_ca = "{folder}/ca.crt"\n{revoked}{extra}\n'
    )
