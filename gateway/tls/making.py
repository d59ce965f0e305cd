"""Creates certificates: of an authority, and of servers and clients signed by it."""

import re
from collections.abc import Iterable, Mapping
from ipaddress import ip_address
from pathlib import Path
from secrets import token_hex
from typing import Final

from gateway.errors import TlsError
from gateway.tls.certificate import ROLE
from gateway.tls.files import read_certificates
from gateway.tls.revoking import index_path, keep, list_path
from gateway.tls.workshop import AUTHORITY, Workshop, find_authority, lock_folder

#: The validity in days: an authority lasts as long as a plant's equipment, others until a later visit.
AUTHORITY_DAYS: Final = 3650
OTHER_DAYS: Final = 730

#: Text without a special meaning in the settings of openssl.
_PLAIN = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9 ._:@+-]{0,62}[A-Za-z0-9._+-])?")
_STEPS: Final = ("request", "certificate")
_KEY: Final = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")

_OF_AUTHORITY: Final = {
    "basicConstraints": "critical,CA:TRUE,pathlen:0",
    "keyUsage": "critical,keyCertSign,cRLSign",
    "subjectKeyIdentifier": "hash",
}
_OF_OTHERS: Final = {
    "basicConstraints": "critical,CA:FALSE",
    "keyUsage": "critical,digitalSignature",
    "subjectKeyIdentifier": "hash",
    "authorityKeyIdentifier": "keyid",
}


def is_plain(text: str) -> bool:
    """Tell whether a name or a role can be used here; others need openssl itself."""
    return _PLAIN.fullmatch(text) is not None


def make_authority(folder: Path, name: str, days: int = AUTHORITY_DAYS) -> Path:
    """Create an authority: `ca.crt` and `ca.key` in `folder`, which is created if necessary. Return its certificate.

    Raises:
        TlsError: there is one already, or it cannot be created.
    """
    with lock_folder(folder), Workshop(folder) as shop:
        certificate, key = _choose_files(folder, AUTHORITY, replace=False)
        for file in (list_path(folder), index_path(folder)):
            if file.exists():
                raise TlsError(f"{file} exists already, from another authority; use another folder")
        settings = shop.settings(name, _OF_AUTHORITY)
        words = ("-x509", "-days", str(days), "-config", settings, "-extensions", "extensions")
        files = ("-keyout", shop.place("key"), "-out", shop.place("certificate"))
        shop.openssl("req", *_KEY, *words, *files)
        shop.deliver({"key": key, "certificate": certificate})
    return certificate


def make_server(
    folder: Path, stem: str, names: Iterable[str], days: int = OTHER_DAYS, *, replace: bool = False
) -> Path:
    """Create a certificate for a server with these names or addresses, and its key. Return its path.

    Raises:
        TlsError: there is no authority in `folder`, `stem` exists already, or it cannot be created.
    """
    names = tuple(names)
    extensions = {"extendedKeyUsage": "serverAuth", "subjectAltName": ",".join(map(_alternative_name, names))}
    return _make_signed(folder, stem, names[0], extensions, days, replace=replace)


def make_client(
    folder: Path, name: str, role: str | None = None, days: int = OTHER_DAYS, *, replace: bool = False
) -> Path:
    """Create a certificate for a client with `role`, None for the null role, and its key. Return its path.

    Raises:
        TlsError: see `make_server`.
    """
    extensions = {"extendedKeyUsage": "clientAuth"}
    if role is not None:
        extensions[ROLE] = f"ASN1:UTF8String:{role}"
    return _make_signed(folder, name, name, extensions, days, replace=replace)


def _make_signed(
    folder: Path, stem: str, name: str, extensions: Mapping[str, str], days: int, *, replace: bool
) -> Path:
    ca, ca_key = find_authority(folder)
    with lock_folder(folder), Workshop(folder) as shop:
        certificate, key = _choose_files(folder, stem, replace=replace)
        _refuse_other_purpose(certificate, extensions["extendedKeyUsage"])
        settings, request, made = shop.settings(name, {**_OF_OTHERS, **extensions}), *map(shop.place, _STEPS)
        shop.openssl("req", *_KEY, "-config", settings, "-keyout", shop.place("key"), "-out", request)
        signing = ("-CA", str(ca), "-CAkey", str(ca_key), "-set_serial", f"0x{int(token_hex(16), 16) >> 1:x}")
        words = ("-days", str(days), "-extfile", settings, "-extensions", "extensions", "-out", made)
        shop.openssl("x509", "-req", "-sha256", "-in", request, *signing, *words)
        keep(folder, stem, certificate)
        keep(folder, stem, Path(made))
        shop.deliver({"key": key, "certificate": certificate})
    return certificate


def _refuse_other_purpose(certificate: Path, purpose: str) -> None:
    """Refuse to replace a certificate of another purpose: the gateway that uses it would not start any more."""
    if certificate.exists() and not read_certificates(certificate)[0].is_for(purpose):
        what, wanted = ("client", "server") if purpose == "serverAuth" else ("server", "client")
        raise TlsError(f"{certificate} is the certificate of a {what}; choose another name for that of the {wanted}")


def _alternative_name(name: str) -> str:
    try:
        return f"IP:{ip_address(name)}"
    except ValueError:
        return f"DNS:{name}"


def _choose_files(folder: Path, stem: str, *, replace: bool) -> tuple[Path, Path]:
    """Return the paths for a certificate and its key.

    Raises:
        TlsError: one of them exists, and must not be replaced.
    """
    places = folder / f"{stem}.crt", folder / f"{stem}.key"
    for file in places:
        if file.exists() and not replace:
            remedy = "" if stem == AUTHORITY else "; --replace makes a new one"
            raise TlsError(f"{file} exists already{remedy}")
    return places
