"""The only module that creates TLS contexts."""

import hashlib
import ssl
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import inf
from typing import Final

from gateway.errors import TlsError
from gateway.tls.certificate import (
    Certificate,
    RevocationList,
    Untrusted,
    find_untrusted,
    find_without_list,
    parse_certificate,
    shorten,
)
from gateway.tls.files import (
    explain_failure,
    locate,
    read,
    read_certificates,
    read_lists,
    refuse_if_exposed,
    refuse_if_no_file,
)
from gateway.tls.settings import ClientTls, SecretFile, ServerTls, TlsSettings

#: Suites of TLS 1.2 with authenticated encryption and forward secrecy; all suites of TLS 1.3 have both. Keys and
#: signatures of less than 112 bits are refused.
CIPHERS: Final = "ECDHE+AESGCM:ECDHE+CHACHA20:@SECLEVEL=2"

_ENCRYPTED: Final = "this key is encrypted; the gateway needs one without a password: openssl pkey -in KEY -out NEW"

#: OpenSSL's errors about a key, in words.
_TROUBLES: Final = {
    "KEY_VALUES_MISMATCH": "this key does not belong to the certificate",
    "EE_KEY_TOO_SMALL": "the key of the certificate is too short: RSA needs 2048 bits",
    "CA_MD_TOO_WEAK": "the certificate is signed with a digest that is too weak",
}


@dataclass(frozen=True, slots=True)
class Expiry:
    """The validity of a certificate or a revocation list."""

    #: The key of the config that names its file.
    what: str
    file: str
    subject: str
    #: End and start of the validity, in seconds since 1970.
    at: float
    since: float = -inf


@dataclass(frozen=True, slots=True)
class Loaded:
    """A context, and facts about the files that it was made from."""

    context: ssl.SSLContext
    expiries: tuple[Expiry, ...]
    #: Contexts with an equal value trust the same peers.
    trust: bytes
    #: Peers that cannot connect, and why.
    warnings: tuple[str, ...] = ()
    #: Sessions must not be resumed after this, in seconds since 1970: only full handshakes check the chain and the
    #: revocation of a client's certificate.
    resumable_until: float = inf


def load(settings: TlsSettings) -> Loaded:
    """Read the files of `settings`, and create their context.

    Raises:
        TlsError: a file is missing, is readable by others, or is invalid.
    """
    loaded = _load_server(settings) if isinstance(settings, ServerTls) else _load_client(settings)
    too_early = find_too_early(loaded.expiries, time.time())
    return replace(loaded, warnings=(*loaded.warnings, *too_early)) if too_early else loaded


def find_too_early(expiries: Iterable[Expiry], now: float) -> tuple[str, ...]:
    """Describe each file that is not valid yet at `now`, in seconds since 1970; usually a clock is wrong."""
    clock = _show_time(now)
    return tuple(
        f"{each.file} is not valid before {_show_time(each.since)}, and the clock here says {clock}"
        for each in expiries
        if each.since > now
    )


def _show_time(at: float) -> str:
    return datetime.fromtimestamp(at, UTC).strftime("%Y-%m-%d %H:%M UTC")


def stop_resuming(context: ssl.SSLContext) -> None:
    """Make new clients do full handshakes, unless they resume a session of TLS 1.2 by its identifier."""
    context.options |= ssl.OP_NO_TICKET
    context.num_tickets = 0


def _load_server(settings: ServerTls) -> Loaded:
    context = _new_context(ssl.PROTOCOL_TLS_SERVER)
    context.num_tickets = 1
    own, trusted = _use_own(context, settings.certificate, settings.key), list[Expiry]()
    warnings: tuple[str, ...] = ()
    trust = hashlib.sha256()
    if settings.clients_ca is not None:
        context.verify_mode = ssl.CERT_REQUIRED
        trusted += _use_authority(context, settings.clients_ca, "clients_ca")
        warnings += _check_authorities(context, settings.clients_ca)
        trust.update(read(settings.clients_ca))
    if settings.crl is not None:
        lists = _use_lists(context, settings.crl)
        file = str(locate(settings.crl))
        trusted += [Expiry("crl", file, "", at, each.this_update) for each in lists if (at := each.next_update)]
        warnings += _check_lists(context, settings, lists)
        trust.update(read(settings.crl))
    until = _find_first_expiry(trusted)
    return Loaded(context, (own, *trusted), trust.digest(), warnings, until)


def _load_client(settings: ClientTls) -> Loaded:
    context = _new_context(ssl.PROTOCOL_TLS_CLIENT)
    expiries: list[Expiry] = []
    if settings.certificate is not None and settings.key is not None:
        expiries.append(_use_own(context, settings.certificate, settings.key))
    if settings.ca is None:
        context.load_default_certs()
        return Loaded(context, tuple(expiries), b"")
    expiries += _use_authority(context, settings.ca, "ca")
    warnings = _check_authorities(context, settings.ca)
    return Loaded(context, tuple(expiries), hashlib.sha256(read(settings.ca)).digest(), warnings)


def _find_first_expiry(trusted: Iterable[Expiry]) -> float:
    """Return the earliest future expiry, in seconds since 1970; infinite if there is none."""
    now = time.time()
    return min((each.at for each in trusted if each.at > now), default=inf)


def _new_context(protocol: ssl._SSLMethod) -> ssl.SSLContext:
    """Create a context without files: TLS 1.2 and 1.3, no compression, no renegotiation (SEC 10.1, 10.4, 10.5)."""
    context = ssl.SSLContext(protocol)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    context.set_ciphers(CIPHERS)
    context.options |= ssl.OP_NO_COMPRESSION | ssl.OP_NO_RENEGOTIATION
    context.options |= ssl.OP_CIPHER_SERVER_PREFERENCE
    return context


def _use_own(context: ssl.SSLContext, certificate: SecretFile, key_file: SecretFile) -> Expiry:
    """Load this certificate, with its chain and key."""
    [first, *_] = _read_expiries(certificate, "certificate")
    key, wanted = locate(key_file), list[bool]()

    def password() -> str:
        """Note that OpenSSL needs a password: it would ask for one on the terminal."""
        wanted.append(True)
        return ""

    try:
        refuse_if_no_file(key)
        refuse_if_exposed(key)
        context.load_cert_chain(locate(certificate), key, password=password)
    except ssl.SSLError as error:
        known = _ENCRYPTED if wanted else _TROUBLES.get(error.reason or "")
        raise TlsError(f"{key}: {known or 'this is no private key in PEM form'}") from error
    except OSError as error:
        raise explain_failure(key, error) from error
    return first


def _use_authority(context: ssl.SSLContext, file: SecretFile, what: str) -> list[Expiry]:
    """Trust the certificates in `file`."""
    expiries = _read_expiries(file, what)
    _add(context, file, "crl", "has revocation lists: name their file by crl")
    if not context.get_ca_certs():
        raise TlsError(f"{locate(file)}: has no certificate of an authority: those here may sign no others")
    return expiries


def _check_authorities(context: ssl.SSLContext, file: SecretFile) -> tuple[str, ...]:
    return _warn(file, find_untrusted(_read_authorities(context, file)))


def _use_lists(context: ssl.SSLContext, file: SecretFile) -> list[RevocationList]:
    """Refuse the certificates that the revocation lists in `file` name."""
    lists = read_lists(file)
    _add(context, file, "x509", "has certificates too: those of authorities belong into clients_ca")
    context.verify_flags |= ssl.VERIFY_CRL_CHECK_CHAIN
    return lists


def _check_lists(context: ssl.SSLContext, settings: ServerTls, lists: list[RevocationList]) -> tuple[str, ...]:
    assert settings.clients_ca is not None and settings.crl is not None  # noqa: S101, PT018 - the config ensures it
    return _warn(settings.crl, find_without_list(_read_authorities(context, settings.clients_ca), lists))


def _warn(file: SecretFile, untrusted: Untrusted) -> tuple[str, ...]:
    """Return warnings about untrusted authorities.

    Raises:
        TlsError: no authority could be trusted.
    """
    said = tuple(f"{locate(file)}: {each}" for each in untrusted.reasons)
    if said and untrusted.are_all:
        raise TlsError(f"{said[0]}. Until then nobody would be trusted")
    return said


def _read_authorities(context: ssl.SSLContext, file: SecretFile) -> list[Certificate]:
    try:
        return [parse_certificate(each) for each in context.get_ca_certs(binary_form=True)]
    except ValueError as wrong:
        raise TlsError(f"{locate(file)}: a certificate in it {wrong}") from wrong


def _add(context: ssl.SSLContext, file: SecretFile, foreign: str, complaint: str) -> None:
    """Load `file`, and refuse contents of the kind `foreign`, which OpenSSL would use too."""
    before = context.cert_store_stats()[foreign]
    try:
        context.load_verify_locations(cafile=locate(file))
    except (ssl.SSLError, OSError) as error:
        raise TlsError(f"{locate(file)}: OpenSSL cannot use it: {error.strerror or error}") from error
    if context.cert_store_stats()[foreign] > before:
        raise TlsError(f"{locate(file)}: {complaint}")


def _read_expiries(file: SecretFile, what: str) -> list[Expiry]:
    """Read the validity of each certificate in `file`, in its order."""
    path = locate(file)
    return [
        Expiry(what, str(path), shorten(each.subject), each.not_after, each.not_before)
        for each in read_certificates(path)
    ]
