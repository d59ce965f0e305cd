"""Certificates and revocation lists: names, validity, the role of a client, and missing issuers."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from gateway.tls import der
from gateway.tls.der import WrongDer

#: The extension with the role (MODBUS/TCP Security v21, 8.3).
ROLE: Final = "1.3.6.1.4.1.50316.802.1"
#: The extension with the purposes (RFC 5280, 4.2.1.12), and the encoded object identifiers of two of them.
_PURPOSES_NAMED: Final = "2.5.29.37"
PURPOSES: Final[Mapping[str, bytes]] = {
    "serverAuth": bytes.fromhex("06 08 2B 06 01 05 05 07 03 01"),
    "clientAuth": bytes.fromhex("06 08 2B 06 01 05 05 07 03 02"),
}
#: The role of a client whose certificate has none.
NULL_ROLE: Final = ""
#: The longest role, and the longest subject shown, in characters: both are logged.
LONGEST_ROLE: Final = 64
LONGEST_SUBJECT: Final = 200

#: Optional parts of a certificate by their tags: its version and its extensions.
_VERSION: Final = 0xA0
_EXTENSIONS: Final = 0xA3
_BOOLEAN: Final = 0x01

_SHORT: Final = {
    "2.5.4.3": "CN",
    "2.5.4.5": "serialNumber",
    "2.5.4.6": "C",
    "2.5.4.7": "L",
    "2.5.4.8": "ST",
    "2.5.4.10": "O",
    "2.5.4.11": "OU",
    "0.9.2342.19200300.100.1.25": "DC",
    "1.2.840.113549.1.9.1": "emailAddress",
}


class WrongRole(ValueError):  # noqa: N818 - named after what it is, as in gateway.errors
    """The role of a certificate violates the specification."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The parsed fields of a certificate."""

    #: In hexadecimal digits.
    serial: str
    #: Names such as `CN=hmi-3,O=Plant 2`. They are complete, for comparison; use `shorten` to show them.
    issuer: str
    subject: str
    #: In seconds since 1970.
    not_before: float
    not_after: float
    _extensions: tuple[tuple[str, bytes], ...]

    def is_for(self, purpose: str) -> bool:
        """Tell whether it is for this `purpose`, a key of PURPOSES. A certificate without purposes is for all."""
        named = [value for extension, value in self._extensions if extension == _PURPOSES_NAMED]
        return not named or any(PURPOSES[purpose] in value for value in named)

    @property
    def role(self) -> str:
        """The role of a Modbus client; NULL_ROLE if the certificate has none.

        Raises:
            WrongRole: it has several, or one that is not a UTF8String of printable characters.
        """
        found = [value for extension, value in self._extensions if extension == ROLE]
        if not found:
            return NULL_ROLE
        if len(found) > 1:
            raise WrongRole("it has more than one role")
        return _role(found[0])


@dataclass(frozen=True, slots=True)
class RevocationList:
    """A revocation list."""

    issuer: str
    #: Start and end of its validity, in seconds since 1970; the end is None if it has none.
    this_update: float
    next_update: float | None


def parse_certificate(data: bytes) -> Certificate:
    """Parse a certificate in DER. Its signature is not checked.

    Raises:
        WrongDer: it is not a certificate.
    """
    signed, *_ = _sequence(der.only(data, der.SEQUENCE))
    parts = [(tag, content) for tag, content in der.elements(signed[1]) if tag != _VERSION]
    if signed[0] != der.SEQUENCE or len(parts) < 6:
        raise WrongDer("is not a certificate")
    (_, serial), (_, _), (_, issuer), (_, validity), (_, subject), *others = parts
    times = [der.time(*moment) for moment in der.elements(validity)]
    if len(times) != 2:
        raise WrongDer("has no validity")
    extensions = next((content for tag, content in others if tag == _EXTENSIONS), b"")
    number = f"{int.from_bytes(serial):02X}"
    number = number if len(number) % 2 == 0 else f"0{number}"
    return Certificate(number, _name(issuer), _name(subject), times[0], times[1], tuple(_extensions(extensions)))


def parse_list(data: bytes) -> RevocationList:
    """Parse a revocation list in DER, without its entries.

    Raises:
        WrongDer: it is not a revocation list.
    """
    signed, *_ = _sequence(der.only(data, der.SEQUENCE))
    parts = [(tag, content) for tag, content in der.elements(signed[1]) if tag != der.INTEGER]
    times = [part for part in parts if part[0] in (der.UTC_TIME, der.GENERALIZED_TIME)]
    if signed[0] != der.SEQUENCE or len(parts) < 3 or not times:
        raise WrongDer("is not a revocation list")
    this_update, *others = (der.time(*each) for each in times)
    return RevocationList(_name(parts[1][1]), this_update, others[0] if others else None)


def is_same_name(one: str, other: str) -> bool:
    """Tell whether two subjects or issuers are equal (RFC 5280, 7.1)."""
    return one.casefold().split() == other.casefold().split()


def shorten(name: str) -> str:
    """Shorten a subject or an issuer to LONGEST_SUBJECT characters: certificates may contain longer ones."""
    return name if len(name) <= LONGEST_SUBJECT else f"{name[: LONGEST_SUBJECT - 3]}..."


@dataclass(frozen=True, slots=True)
class Untrusted:
    """Authorities that cannot be trusted completely: certificates that they signed are refused."""

    #: The reason for each of them.
    reasons: tuple[str, ...]
    #: Whether no other authority is left.
    are_all: bool


def find_untrusted(authorities: Sequence[Certificate]) -> Untrusted:
    """Find authorities whose issuer is missing: a chain of certificates must end at a self-signed one."""
    reasons = tuple(
        f"{shorten(each.subject)} is an authority that {shorten(each.issuer)} has signed, "
        "whose certificate is missing: add it"
        for each in authorities
        if not any(is_same_name(each.issuer, other.subject) for other in authorities)
    )
    return Untrusted(reasons, not any(is_same_name(each.issuer, each.subject) for each in authorities))


def find_without_list(authorities: Sequence[Certificate], lists: Sequence[RevocationList]) -> Untrusted:
    """Find authorities without a revocation list. If there is any list, each authority of a chain needs one."""
    missing = [each for each in authorities if not any(is_same_name(each.subject, listed.issuer) for listed in lists)]
    reasons = tuple(
        f"has no revocation list of {shorten(each.subject)}, "
        f"only of {' and '.join(shorten(listed.issuer) for listed in lists)}"
        for each in missing
    )
    return Untrusted(reasons, len(missing) == len(authorities))


def _sequence(content: bytes) -> list[der.Element]:
    found = list(der.elements(content))
    if not found:
        raise WrongDer("is empty")
    return found


def _role(extension: bytes) -> str:
    try:
        role = der.only(extension, der.UTF8_STRING).decode("utf-8")
    except ValueError as wrong:
        raise WrongRole("its role is not a UTF8String") from wrong
    if not role:
        raise WrongRole("its role is empty: a certificate without a role has no such extension")
    if len(role) > LONGEST_ROLE or not role.isprintable():
        raise WrongRole(f"its role is longer than {LONGEST_ROLE} characters, or has some that cannot be seen")
    return role


def _extensions(content: bytes) -> Iterator[tuple[str, bytes]]:
    if not content:
        return
    for tag, extension in der.elements(der.only(content, der.SEQUENCE)):
        fields = [field for field in der.elements(extension) if field[0] != _BOOLEAN]
        if tag != der.SEQUENCE or [kind for kind, _ in fields] != [der.OBJECT_IDENTIFIER, der.OCTET_STRING]:
            raise WrongDer("has a malformed extension")
        yield der.identifier(fields[0][1]), fields[1][1]


def _name(name: bytes) -> str:
    """Format a name as in RFC 4514, but in the order of the certificate, and with unprintable characters escaped."""
    parts = [_attribute(attribute) for _, group in der.elements(name) for _, attribute in der.elements(group)]
    return ",".join(parts) or "(empty)"


def _attribute(content: bytes) -> str:
    fields = _sequence(content)
    if len(fields) != 2:
        raise WrongDer("has a malformed subject")
    kind, value = der.identifier(fields[0][1]), der.text(*fields[1])
    visible = "".join(each if each.isprintable() and each not in ',\\"' else f"\\{ord(each):x}" for each in value)
    return f"{_SHORT.get(kind, kind)}={visible}"
