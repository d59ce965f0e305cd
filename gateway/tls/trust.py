"""Peers that cannot connect although their authority is configured: OpenSSL needs another certificate or list."""

from collections.abc import Sequence
from dataclasses import dataclass

from gateway.tls.certificate import Certificate, RevocationList, is_same_name, shorten


@dataclass(frozen=True, slots=True)
class Untrusted:
    """`said` explains for each unusable authority why its peers are not trusted; `is_everybody` if all are unusable."""

    said: tuple[str, ...]
    is_everybody: bool


def find_untrusted(authorities: Sequence[Certificate]) -> Untrusted:
    """Authorities whose own issuer is missing: a chain of certificates must end at one that has signed itself."""
    said = tuple(
        f"{shorten(each.subject)} is an authority that {shorten(each.issuer)} has signed, "
        "whose certificate is missing: add it"
        for each in authorities
        if not any(is_same_name(each.issuer, other.subject) for other in authorities)
    )
    return Untrusted(said, not any(is_same_name(each.issuer, each.subject) for each in authorities))


def find_without_list(authorities: Sequence[Certificate], lists: Sequence[RevocationList]) -> Untrusted:
    """Authorities that have no revocation list. If there is any, each of a chain needs one."""
    missing = [each for each in authorities if not any(is_same_name(each.subject, listed.issuer) for listed in lists)]
    said = tuple(
        f"has no revocation list of {shorten(each.subject)}, "
        f"only of {' and '.join(shorten(listed.issuer) for listed in lists)}"
        for each in missing
    )
    return Untrusted(said, len(missing) == len(authorities))
