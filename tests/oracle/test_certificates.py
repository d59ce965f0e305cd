"""What certificates and revocation lists say, against the library cryptography: whole ones, and damaged ones.

What damaged ones say only counts where OpenSSL has found a good signature; what is looked for here is a certificate
that says one thing to us and another to somebody else.
"""

from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.tls.certificate import NULL_ROLE, ROLE, Certificate, WrongRole, parse_certificate, parse_list
from gateway.tls.der import WrongDer

x509 = pytest.importorskip("cryptography.x509", reason="not on this kind of machine")
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey  # noqa: E402
from cryptography.hazmat.primitives.serialization import Encoding  # noqa: E402
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID  # noqa: E402

KEY = Ed25519PrivateKey.generate()
THEIR_ROLE = x509.ObjectIdentifier(ROLE)
SHORT = {
    NameOID.COMMON_NAME: "CN",
    NameOID.ORGANIZATION_NAME: "O",
    NameOID.ORGANIZATIONAL_UNIT_NAME: "OU",
    NameOID.LOCALITY_NAME: "L",
    NameOID.TITLE: "2.5.4.12",
}
#: Short enough that no subject is cut off.
TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=8)
NAMES = st.lists(st.tuples(st.sampled_from(list(SHORT)), TEXT), max_size=4)
MOMENTS = st.datetimes(datetime(1951, 1, 1), datetime(2200, 1, 1)).map(lambda at: at.replace(microsecond=0, tzinfo=UTC))  # noqa: DTZ001


def utf8_string(content: bytes) -> bytes:
    """In DER."""
    length = bytes((len(content),)) if len(content) < 0x80 else bytes((0x82, *len(content).to_bytes(2)))
    return b"\x0c" + length + content


#: The value of the role's extension: right, nearly right, or anything.
ROLE_VALUES = st.one_of(
    st.text(max_size=70).map(lambda text: utf8_string(text.encode(errors="surrogatepass"))),
    st.binary(max_size=12).map(utf8_string),
    st.binary(max_size=12),
)


@st.composite
def certificates(draw: st.DrawFn) -> x509.Certificate:
    begin, end = sorted((draw(MOMENTS), draw(MOMENTS)))
    builder = (
        x509.CertificateBuilder()
        .subject_name(_name(draw(NAMES)))
        .issuer_name(_name(draw(NAMES)))
        .public_key(KEY.public_key())
        .serial_number(draw(st.integers(1, 2**159 - 1)))
        .not_valid_before(begin)
        .not_valid_after(end + timedelta(seconds=1))
    )
    if draw(st.booleans()):
        usage = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.CLIENT_AUTH])
        builder = builder.add_extension(usage, critical=draw(st.booleans()))
    if draw(st.booleans()):
        role = x509.UnrecognizedExtension(THEIR_ROLE, draw(ROLE_VALUES))
        builder = builder.add_extension(role, critical=draw(st.booleans()))
    if draw(st.booleans()):
        constraints = x509.BasicConstraints(ca=False, path_length=None)
        builder = builder.add_extension(constraints, critical=draw(st.booleans()))
    return builder.sign(KEY, None)


@given(certificates())
def test_a_whole_certificate_says_the_same_to_both(theirs: x509.Certificate) -> None:
    ours = parse_certificate(theirs.public_bytes(Encoding.DER))
    assert _said(ours) == _told(theirs)
    assert _role(ours) == _their_role(theirs)


@given(certificates(), st.data())
def test_a_damaged_certificate_says_the_same_to_both_or_nothing_to_us(
    whole: x509.Certificate, data: st.DataObject
) -> None:
    damaged = data.draw(damage(whole.public_bytes(Encoding.DER)))
    try:
        ours = parse_certificate(damaged)
    except WrongDer:
        return
    try:
        theirs = x509.load_der_x509_certificate(damaged)
        their_role, told = _their_role(theirs), _told(theirs)
    except (ValueError, Warning, x509.DuplicateExtension, x509.InvalidVersion):
        return  # it refuses what OpenSSL accepts too, such as lengths that could be shorter
    assert _role(ours) in (their_role, None)
    assert _said(ours)[:3] == told[:3]


@given(NAMES, MOMENTS, st.integers(1, 10**9), st.lists(st.integers(1, 2**100), max_size=3, unique=True))
def test_a_revocation_list_says_the_same_to_both(
    issuer: list[tuple[x509.ObjectIdentifier, str]], began: datetime, seconds: int, revoked: list[int]
) -> None:
    builder = x509.CertificateRevocationListBuilder().issuer_name(_name(issuer)).last_update(began)
    for number in revoked:
        one = x509.RevokedCertificateBuilder().serial_number(number).revocation_date(began).build()
        builder = builder.add_revoked_certificate(one)
    theirs = builder.next_update(began + timedelta(seconds=seconds)).sign(KEY, None)
    ours = parse_list(theirs.public_bytes(Encoding.DER))
    assert ours.issuer == _shown(theirs.issuer)
    assert ours.next_update == theirs.next_update_utc.timestamp()


@st.composite
def damage(draw: st.DrawFn, whole: bytes) -> bytes:
    """Some bytes are changed, a piece is removed, or a piece is repeated or put elsewhere."""
    data = bytearray(whole)
    for _ in range(draw(st.integers(1, 3))):
        first, second, third = sorted(draw(st.integers(0, len(data) - 1)) for _ in range(3))
        kind = draw(st.sampled_from(["change", "change", "remove", "repeat", "swap"]))
        if kind == "change":
            data[first] = draw(st.integers(0, 255))
        elif kind == "remove":
            del data[first : min(second, first + 3)]
        elif kind == "repeat":
            data[third:third] = data[first:second]
        else:
            data[first:third] = data[second:third] + data[first:second]
        if len(data) < 2:
            return whole
    return bytes(data)


def _name(parts: list[tuple[x509.ObjectIdentifier, str]]) -> x509.Name:
    return x509.Name([x509.NameAttribute(kind, value) for kind, value in parts])


def _said(ours: Certificate) -> tuple[object, ...]:
    return int(ours.serial, 16), ours.not_before, ours.not_after, ours.subject, ours.issuer


def _told(theirs: x509.Certificate) -> tuple[object, ...]:
    times = theirs.not_valid_before_utc.timestamp(), theirs.not_valid_after_utc.timestamp()
    return theirs.serial_number, *times, _shown(theirs.subject), _shown(theirs.issuer)


def _shown(name: x509.Name) -> str:
    def visible(value: str) -> str:
        return "".join(each if each.isprintable() and each not in ',\\"' else f"\\{ord(each):x}" for each in value)

    parts = [f"{SHORT.get(each.oid, each.oid.dotted_string)}={visible(each.value)}" for each in name]
    return ",".join(parts) or "(empty)"


def _role(ours: Certificate) -> str | None:
    try:
        return ours.role
    except WrongRole:
        return None


def _their_role(theirs: x509.Certificate) -> str | None:
    """The role after the specification, by what the library finds; None if it is malformed."""
    try:
        value = theirs.extensions.get_extension_for_oid(THEIR_ROLE).value.value
    except x509.ExtensionNotFound:
        return NULL_ROLE
    content = value[2:] if value[1:2] < b"\x80" else value[4:]
    if value != utf8_string(content):
        return None
    try:
        role = content.decode()
    except UnicodeDecodeError:
        return None
    return role if 0 < len(role) <= 64 and role.isprintable() else None
