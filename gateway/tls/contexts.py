"""The one place that makes TLS contexts, from files that were read and checked."""

import ssl
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

from gateway.errors import TlsError
from gateway.tls.certificate import Certificate, parse_certificate, read_next_update
from gateway.tls.files import path_of, refuse_if_exposed
from gateway.tls.secret_file import SecretFile
from gateway.tls.settings import ClientTls, ServerTls, TlsSettings

#: Suites of TLS 1.2 with authenticated encryption and forward secrecy; those of TLS 1.3 all have both. Keys and
#: signatures of less than 112 bits are refused.
CIPHERS: Final = "ECDHE+AESGCM:ECDHE+CHACHA20:@SECLEVEL=2"
#: The largest file that is read: an authority file may have a hundred certificates.
LARGEST_FILE: Final = 1024 * 1024

_CERTIFICATE: Final = "CERTIFICATE"
_LIST: Final = "X509 CRL"
_HOW_TO_MAKE: Final = "modbus-gateway certificates makes one"

#: What OpenSSL calls the trouble with a key, in words.
_TROUBLES: Final = {
    "KEY_VALUES_MISMATCH": "this key does not belong to the certificate",
    "BAD_DECRYPT": "this key is encrypted; the gateway needs one without a password",
    "BAD_PASSWORD_READ": "this key is encrypted; the gateway needs one without a password",
    "EE_KEY_TOO_SMALL": "the key of the certificate is too short: RSA needs 2048 bits",
    "CA_MD_TOO_WEAK": "the certificate is signed with a digest that is too weak",
}


@dataclass(frozen=True, slots=True)
class Expiry:
    """Until when a file is valid, in seconds since 1970. `what` is the key of the config that names it."""

    what: str
    file: str
    subject: str
    at: float


@dataclass(frozen=True, slots=True)
class Loaded:
    """A context and what it was made of. Peers are trusted alike by two with the same `trust`."""

    context: ssl.SSLContext
    expiries: tuple[Expiry, ...]
    trust: bytes


def load(settings: TlsSettings) -> Loaded:
    """Read the files of `settings`, and make a context of them.

    Raises:
        TlsError: one of them is missing, can be read by others, or is not what it should be.
    """
    if isinstance(settings, ServerTls):
        return _load_server(settings)
    return _load_client(settings)


def read_certificates(path: Path) -> list[Certificate]:
    """The certificates in a PEM file; at least one.

    Raises:
        TlsError: it cannot be read, or has none.
    """
    try:
        return [parse_certificate(block) for block in _blocks(SecretFile(str(path)), _CERTIFICATE)]
    except ValueError as wrong:
        raise TlsError(f"{path}: the certificate in it {wrong}") from wrong


def _load_server(settings: ServerTls) -> Loaded:
    context = _new_context(ssl.PROTOCOL_TLS_SERVER)
    context.num_tickets = 1
    expiries = [_use_own(context, settings)]
    trust = sha256()
    if settings.clients_ca is not None:
        context.verify_mode = ssl.CERT_REQUIRED
        expiries += _use_authority(context, settings.clients_ca, "clients_ca")
        trust.update(_read(settings.clients_ca))
    if settings.crl is not None:
        expiries += _use_list(context, settings.crl)
        trust.update(_read(settings.crl))
    return Loaded(context, tuple(expiries), trust.digest())


def _load_client(settings: ClientTls) -> Loaded:
    context = _new_context(ssl.PROTOCOL_TLS_CLIENT)
    expiries = (_use_own(context, settings), *_use_authority(context, settings.ca, "ca"))
    return Loaded(context, expiries, sha256(_read(settings.ca)).digest())


def _new_context(protocol: ssl._SSLMethod) -> ssl.SSLContext:
    """A context without files: TLS 1.2 and 1.3, no compression, no renegotiation (SEC 10.1, 10.4, 10.5)."""
    context = ssl.SSLContext(protocol)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(CIPHERS)
    context.options |= ssl.OP_NO_COMPRESSION | ssl.OP_NO_RENEGOTIATION
    context.options |= ssl.OP_CIPHER_SERVER_PREFERENCE
    return context


def _use_own(context: ssl.SSLContext, settings: TlsSettings) -> Expiry:
    """Show the certificate of `settings`, with its chain."""
    [first, *_] = _expiries(settings.certificate, "certificate")
    key = _path(settings.key)
    try:
        refuse_if_exposed(key)
        # Without a password, OpenSSL would ask for that of an encrypted key on the terminal.
        context.load_cert_chain(_path(settings.certificate), key, password=lambda: "")
    except ssl.SSLError as error:
        raise TlsError(f"{key}: {_TROUBLES.get(error.reason or '', 'this is no private key in PEM form')}") from error
    except OSError as error:
        raise _unreadable(key, error) from error
    return first


def _use_authority(context: ssl.SSLContext, file: SecretFile, what: str) -> list[Expiry]:
    """Trust the certificates in `file`."""
    expiries = _expiries(file, what)
    _add(context, file)
    if not context.get_ca_certs():
        raise TlsError(f"{_path(file)}: has no certificate of an authority: those here may sign no others")
    return expiries


def _use_list(context: ssl.SSLContext, file: SecretFile) -> list[Expiry]:
    """Refuse what the revocation lists in `file` name. Each authority needs one."""
    path = _path(file)
    found = [Expiry("crl", str(path), "", at) for at in map(_next_update, _blocks(file, _LIST)) if at is not None]
    _add(context, file)
    context.verify_flags |= ssl.VERIFY_CRL_CHECK_CHAIN
    return found


def _add(context: ssl.SSLContext, file: SecretFile) -> None:
    try:
        context.load_verify_locations(cafile=_path(file))
    except (ssl.SSLError, OSError) as error:
        raise TlsError(f"{_path(file)}: OpenSSL cannot use it: {error.strerror or error}") from error


def _expiries(file: SecretFile, what: str) -> list[Expiry]:
    """Until when each certificate in `file` is valid, in its order."""
    path = _path(file)
    return [Expiry(what, str(path), each.subject, each.not_after) for each in read_certificates(path)]


def _next_update(block: bytes) -> float | None:
    try:
        return read_next_update(block)
    except ValueError as wrong:
        raise TlsError(f"the revocation list {wrong}") from wrong


def _blocks(file: SecretFile, kind: str) -> list[bytes]:
    """The DER of each block of this kind in a PEM file; at least one."""
    text = _read(file).decode("ascii", errors="replace")
    parts = text.split(f"-----BEGIN {kind}-----")[1:]
    if not parts:
        raise TlsError(f"{_path(file)}: has no {kind} in PEM form; {_HOW_TO_MAKE}")
    return [_decode(file, part.partition(f"-----END {kind}-----")[0]) for part in parts]


def _decode(file: SecretFile, body: str) -> bytes:
    try:
        return ssl.PEM_cert_to_DER_cert(f"-----BEGIN CERTIFICATE-----{body}-----END CERTIFICATE-----")
    except ValueError as wrong:
        raise TlsError(f"{_path(file)}: is damaged: {wrong}") from wrong


def _read(file: SecretFile) -> bytes:
    path = _path(file)
    try:
        with path.open("rb") as stream:
            return stream.read(LARGEST_FILE)
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> TlsError:
    remedy = f"; {_HOW_TO_MAKE}" if isinstance(error, FileNotFoundError) else ""
    reason = error.strerror or str(error)
    return TlsError(f"{path}: {reason[:1].lower()}{reason[1:]}{remedy}")


def _path(file: SecretFile) -> Path:
    try:
        return path_of(file)
    except OSError as error:
        raise TlsError(f"{file.name}: {error.strerror}") from error
