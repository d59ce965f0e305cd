"""Makes certificates: an authority, and what it signs. The program `openssl` does the work.

(The library `cryptography` needs cffi, which has no wheel for armv7l, and `openssl` is installed on every machine.)
"""

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping
from ipaddress import ip_address
from pathlib import Path
from secrets import token_hex
from typing import Final, Self

from gateway.errors import TlsError
from gateway.tls.certificate import ROLE

#: How long what is made is valid, in days: an authority as long as a plant's equipment, others until a next visit.
AUTHORITY_DAYS: Final = 3650
OTHER_DAYS: Final = 730
#: What an authority's files are called in its folder.
AUTHORITY: Final = "ca"
#: How long openssl may take for one step, in seconds: a small machine has little randomness after its start.
DEADLINE: Final = 60.0

#: What has no meaning of its own in a file of settings of openssl.
_PLAIN = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9 ._:@+-]{0,62}[A-Za-z0-9._+-])?")
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
    """Whether a name or a role can be put into a certificate here; others can be made with openssl itself."""
    return _PLAIN.fullmatch(text) is not None


def make_authority(folder: Path, name: str, days: int = AUTHORITY_DAYS) -> Path:
    """Make an authority: `ca.crt` and `ca.key` in `folder`, which is made if necessary. Returns its certificate.

    Raises:
        TlsError: there is one already, or it cannot be made.
    """
    certificate, key = _places(folder, AUTHORITY, replace=False)
    with _Workshop(folder) as shop:
        settings = shop.settings(name, _OF_AUTHORITY)
        words = ("-x509", "-days", str(days), "-config", settings, "-extensions", "extensions")
        files = ("-keyout", shop.place("key"), "-out", shop.place("certificate"))
        shop.openssl("req", *_KEY, *words, *files)
        shop.deliver({"key": key, "certificate": certificate})
    return certificate


def make_server(
    folder: Path, stem: str, names: Iterable[str], days: int = OTHER_DAYS, *, replace: bool = False
) -> Path:
    """Make a certificate for a server that is reached by these names or addresses, and its key.

    Raises:
        TlsError: there is no authority in `folder`, there is one of this name already, or it cannot be made.
    """
    names = tuple(names)
    extensions = {"extendedKeyUsage": "serverAuth", "subjectAltName": ",".join(map(_alternative_name, names))}
    return _make_signed(folder, stem, names[0], extensions, days, replace=replace)


def make_client(
    folder: Path, name: str, role: str | None = None, days: int = OTHER_DAYS, *, replace: bool = False
) -> Path:
    """Make a certificate for a client with `role`, None for the null role, and its key.

    Raises:
        TlsError: as `make_server`.
    """
    extensions = {"extendedKeyUsage": "clientAuth"}
    if role is not None:
        extensions[ROLE] = f"ASN1:UTF8String:{role}"
    return _make_signed(folder, name, name, extensions, days, replace=replace)


def revoke(folder: Path, certificate: Path, days: int = AUTHORITY_DAYS) -> Path:
    """Put a certificate on the revocation list of the authority, `ca.crl`; returns that.

    Raises:
        TlsError: there is no authority in `folder`, or the list cannot be made.
    """
    ca, key = _authority(folder)
    index, crl = folder / f"{AUTHORITY}.index", folder / f"{AUTHORITY}.crl"
    with _Workshop(folder) as shop:
        own_index = Path(shop.place("index"))
        own_index.write_bytes(index.read_bytes() if index.exists() else b"")
        settings = Path(shop.place("settings"))
        settings.write_text(
            f"[ca]\ndefault_ca=own\n[own]\ndatabase={own_index}\ncertificate={ca}\nprivate_key={key}\n"
            f"default_md=sha256\ndefault_crl_days={days}\nunique_subject=no\n"
        )
        shop.openssl("ca", "-config", str(settings), "-revoke", str(certificate))
        shop.openssl("ca", "-config", str(settings), "-gencrl", "-out", shop.place("crl"))
        shop.deliver({"index": index, "crl": crl})
    return crl


def _make_signed(
    folder: Path, stem: str, name: str, extensions: Mapping[str, str], days: int, *, replace: bool
) -> Path:
    ca, ca_key = _authority(folder)
    certificate, key = _places(folder, stem, replace=replace)
    with _Workshop(folder) as shop:
        settings = shop.settings(name, {**_OF_OTHERS, **extensions})
        request = shop.place("request")
        shop.openssl("req", *_KEY, "-config", settings, "-keyout", shop.place("key"), "-out", request)
        signing = ("-CA", str(ca), "-CAkey", str(ca_key), "-set_serial", f"0x{int(token_hex(16), 16) >> 1:x}")
        made = (
            "-days",
            str(days),
            "-extfile",
            settings,
            "-extensions",
            "extensions",
            "-out",
            shop.place("certificate"),
        )
        shop.openssl("x509", "-req", "-sha256", "-in", request, *signing, *made)
        shop.deliver({"key": key, "certificate": certificate})
    return certificate


def _alternative_name(name: str) -> str:
    try:
        return f"IP:{ip_address(name)}"
    except ValueError:
        return f"DNS:{name}"


def _authority(folder: Path) -> tuple[Path, Path]:
    certificate, key = folder / f"{AUTHORITY}.crt", folder / f"{AUTHORITY}.key"
    for file in (certificate, key):
        if not file.exists():
            raise TlsError(f"{file}: there is no authority; make one first: modbus-gateway certificates authority")
    return certificate.absolute(), key.absolute()


def _places(folder: Path, stem: str, *, replace: bool) -> tuple[Path, Path]:
    """Where a certificate and its key go."""
    places = folder / f"{stem}.crt", folder / f"{stem}.key"
    for file in places:
        if file.exists() and not replace:
            remedy = "" if stem == AUTHORITY else "; --replace makes a new one"
            raise TlsError(f"{file} exists already{remedy}")
    return places


class _Workshop:
    """A folder for files that are not ready yet, beside those that they become."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> Self:
        if shutil.which("openssl") is None:
            raise TlsError("the program openssl was not found. On Debian: apt install openssl")
        try:
            self._folder.mkdir(mode=0o755, parents=True, exist_ok=True)
            self._temporary = tempfile.TemporaryDirectory(prefix=".new-", dir=self._folder)
        except OSError as error:
            raise TlsError(f"{self._folder}: {(error.strerror or str(error)).lower()}") from error
        return self

    def __exit__(self, *_: object) -> None:
        self._temporary.cleanup()

    def place(self, name: str) -> str:
        """Where a file is made."""
        return str(Path(self._temporary.name, name).absolute())

    def settings(self, name: str, extensions: Mapping[str, str]) -> str:
        """A file of settings for openssl."""
        lines = [
            "[req]\nprompt=no\nutf8=yes\ndistinguished_name=subject",
            f"[subject]\nCN={name}",
            "[extensions]",
            *(f"{key}={value}" for key, value in extensions.items()),
        ]
        file = Path(self.place("settings"))
        file.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return str(file)

    def openssl(self, *words: str) -> None:
        """Run `openssl WORDS`; only its owner can read what it makes.

        Raises:
            TlsError: it failed.
        """
        command = ["openssl", *words]
        try:
            done = subprocess.run(  # noqa: S603 - nothing in `words` is taken for an option or a command
                command, capture_output=True, text=True, timeout=DEADLINE, check=False, umask=0o077
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise TlsError(f"openssl {words[0]} failed: {error}") from error
        if done.returncode:
            *_, why = done.stderr.strip().splitlines() or ["no reason given"]
            raise TlsError(f"openssl {words[0]} failed: {why}")

    def deliver(self, files: Mapping[str, Path]) -> None:
        """Put what was made in its place. All but keys can be read by everybody."""
        for name, place in files.items():
            made = Path(self.place(name))
            made.chmod(0o600 if name == "key" else 0o644)
            made.replace(place)
