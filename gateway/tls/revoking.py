"""Certificates that an authority has issued, and those that it has revoked.

Copies of all certificates are kept in the folder `issued`, because replaced ones are still valid.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.errors import TlsError
from gateway.tls.certificate import Certificate
from gateway.tls.files import read_certificates
from gateway.tls.workshop import AUTHORITY, Workshop, find_authority, lock_folder

#: The validity of a revocation list in days, long enough to need no renewal.
LIST_DAYS: Final = 3650
_ISSUED: Final = "issued"


@dataclass(frozen=True, slots=True)
class Issued:
    """A certificate and its path."""

    file: Path
    certificate: Certificate


def keep(folder: Path, stem: str, file: Path) -> None:
    """Keep a copy of the certificate in `file`, if there is a readable one, as issued to `stem`.

    Raises:
        TlsError: it cannot be written.
    """
    try:
        serial = read_certificates(file)[0].serial
    except TlsError:  # missing, or damaged and being replaced
        return
    place = folder / _ISSUED / f"{stem}.{serial}.crt"
    try:
        place.parent.mkdir(mode=0o755, exist_ok=True)
        place.write_bytes(file.read_bytes())
    except OSError as error:
        raise TlsError(f"{place}: {(error.strerror or str(error)).lower()}") from error


def find_issued(folder: Path, stem: str) -> list[Issued]:
    """Find the certificates that the authority in `folder` has issued to `stem`, the one in use first.

    Raises:
        TlsError: one of them cannot be read.
    """
    in_use = folder / f"{stem}.crt"
    files = [in_use] if in_use.exists() else []
    files += sorted((folder / _ISSUED).glob(f"{stem}.*.crt"))
    found: dict[str, Issued] = {}
    for file in files:
        certificate = read_certificates(file)[0]
        if file == in_use or file.name == f"{stem}.{certificate.serial}.crt":
            found.setdefault(certificate.serial, Issued(file, certificate))
    return list(found.values())


def find_replaced(folder: Path, stem: str) -> list[Issued]:
    """Find the certificates of `stem` before the one in use that are still valid and not revoked.

    Raises:
        TlsError: see `find_issued`.
    """
    gone, now = read_revoked(folder), time.time()
    in_use = folder / f"{stem}.crt"
    return [
        each
        for each in find_issued(folder, stem)
        if each.file != in_use and each.certificate.serial not in gone and each.certificate.not_after > now
    ]


def read_revoked(folder: Path) -> set[str]:
    """Read the serial numbers that the authority in `folder` has revoked."""
    index = index_path(folder)
    rows = (line.split("\t") for line in index.read_text().splitlines()) if index.exists() else ()
    return {row[3] for row in rows if row[0] == "R" and len(row) > 3}


def revoke(folder: Path, files: list[Path]) -> Path:
    """Add the certificates in these files to the authority's revocation list, `ca.crl`. Return its path.

    Raises:
        TlsError: there is no authority in `folder`, it has not issued all of them, another command keeps the folder
            locked, or the list cannot be created.
    """
    ca, key = find_authority(folder)
    with lock_folder(folder), Workshop(folder) as shop:
        index, gone = index_path(folder), read_revoked(folder)
        Path(shop.place("index")).write_bytes(index.read_bytes() if index.exists() else b"")
        settings = shop.place("settings")
        Path(settings).write_text(  # no path: some characters are special here
            f"[ca]\ndefault_ca=own\n[own]\ndatabase=index\n"
            f"default_md=sha256\ndefault_crl_days={LIST_DAYS}\nunique_subject=no\n"
        )
        ca_words = ("ca", "-config", settings, "-cert", str(ca), "-keyfile", str(key))
        for file in files:
            if read_certificates(file)[0].serial not in gone:
                _refuse_if_not_of(ca, file, shop)
                shop.openssl(*ca_words, "-revoke", str(file.absolute()))
        shop.openssl(*ca_words, "-gencrl", "-out", shop.place("crl"))
        shop.deliver({"index": index, "crl": list_path(folder)})
    return list_path(folder)


def list_path(folder: Path) -> Path:
    """Return the path of an authority's revocation list."""
    return folder / f"{AUTHORITY}.crl"


def index_path(folder: Path) -> Path:
    """Return the path of the index of revoked certificates, in the format of openssl."""
    return folder / f"{AUTHORITY}.index"


def _refuse_if_not_of(ca: Path, file: Path, shop: Workshop) -> None:
    """Refuse a certificate that the authority has not signed; expired ones are accepted."""
    if read_certificates(file) == read_certificates(ca):
        raise TlsError(f"{file}: an authority cannot revoke itself; name another one in clients_ca")
    only = ("-no-CAfile", "-no-CApath", "-no-CAstore", "-partial_chain", "-no_check_time")
    try:
        shop.openssl("verify", *only, "-trusted", str(ca), str(file.absolute()))
    except TlsError as error:
        raise TlsError(f"{file} was not issued by {ca}, so that cannot revoke it") from error
