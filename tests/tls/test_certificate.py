"""What is read out of certificates, with openssl's own as the measure."""

import random
import ssl
import time
from pathlib import Path

import pytest

from gateway.tls.certificate import (
    LONGEST_SUBJECT,
    NULL_ROLE,
    Certificate,
    RevocationList,
    WrongRole,
    find_untrusted,
    find_without_list,
    parse_certificate,
    parse_list,
    shorten,
)
from gateway.tls.der import WrongDer
from kit import pki
from kit.pki import NOT_UTF8, TWO_ROLES, WRONG_TEXT, der, openssl, signed

DAY = 86_400.0


def of(name: str) -> bytes:
    return der(pki.pki() / f"{name}.crt")


def test_a_certificate_says_whose_it_is_how_long_it_is_valid_and_the_role() -> None:
    certificate = parse_certificate(of("operator"))
    assert certificate.subject == "CN=operator"
    assert certificate.role == "operator"
    assert certificate.not_before <= time.time() + 1
    assert certificate.not_after - certificate.not_before == pytest.approx(730 * DAY, abs=2)


def test_without_a_role_it_is_the_null_role() -> None:
    assert parse_certificate(of("nobody")).role == NULL_ROLE
    assert parse_certificate(of("server")).role == NULL_ROLE


@pytest.mark.parametrize(
    ("extension", "why"),
    [
        (TWO_ROLES, "more than one role"),
        (WRONG_TEXT, "not a UTF8String"),
        (NOT_UTF8, "not a UTF8String"),
        ("1.3.6.1.4.1.50316.802.1=DER:0c:00", "its role is empty"),
        ("1.3.6.1.4.1.50316.802.1=DER:0c:02:41:0a", "cannot be seen"),
        ("1.3.6.1.4.1.50316.802.1=DER:0c:01:41:0c:01:42", "not a UTF8String"),
        ("1.3.6.1.4.1.50316.802.1=DER:0c:05:41", "not a UTF8String"),
        ("1.3.6.1.4.1.50316.802.1=ASN1:UTF8String:" + 65 * "a", "longer than 64"),
    ],
)
def test_a_role_that_is_not_as_specified_is_none_at_all(tmp_path: Path, extension: str, why: str) -> None:
    certificate = parse_certificate(der(signed(tmp_path, "odd", extension)))
    assert certificate.subject == "CN=odd"
    with pytest.raises(WrongRole, match=why):
        _ = certificate.role


def test_a_role_may_have_any_visible_character_and_the_extension_may_be_critical(tmp_path: Path) -> None:
    name = "Wärter 控".encode()
    text = "1.3.6.1.4.1.50316.802.1=critical,DER:" + bytes((0x0C, len(name), *name)).hex(":")
    assert parse_certificate(der(signed(tmp_path, "odd", text))).role == "Wärter 控"


def test_until_when_a_revocation_list_is_valid() -> None:
    text = (pki.pki() / "ca.crl").read_text().replace("X509 CRL", "CERTIFICATE")
    listed = parse_list(ssl.PEM_cert_to_DER_cert(text))
    assert listed.issuer == "CN=Plant 2"
    assert listed.next_update is not None
    assert listed.next_update - time.time() == pytest.approx(3650 * DAY, abs=3600)


def test_a_subject_shows_nothing_that_could_pass_for_something_else() -> None:
    data = of("operator").replace(b"operator", b'op,\x1b[2";')  # its name and its role
    certificate = parse_certificate(data)
    assert certificate.subject == r"CN=op\2c\1b[2\22;"
    with pytest.raises(WrongRole):
        _ = certificate.role


def test_damage_is_found_or_does_no_harm() -> None:
    chance, whole = random.Random(20), of("operator")
    for _ in range(20_000):
        data = bytearray(whole)
        for _ in range(chance.randint(1, 3)):
            at = chance.randrange(len(data))
            data[at] = chance.randrange(256)
        cut = bytes(data[: chance.choice([len(data), chance.randrange(len(data))])])
        for read in (lambda given: parse_certificate(given).role, parse_list):
            try:
                read(cut)
            except (WrongDer, WrongRole):
                continue


def test_names_are_compared_whole_and_shown_cut() -> None:
    def authority(subject: str, issuer: str) -> Certificate:
        return Certificate("01", issuer, subject, 0.0, 1.0, ())

    unit = "OU=" + 210 * "x"
    long, other = f"{unit},CN=hall a", f"{unit},CN=hall b"
    assert not find_untrusted([authority(long, long)]).reasons
    (said,) = find_untrusted([authority(long, other)]).reasons
    assert len(said) < 2 * LONGEST_SUBJECT + 100
    assert not find_without_list([authority(long, long)], [RevocationList(long, 0.0, None)]).reasons
    assert find_without_list([authority(long, long)], [RevocationList(other, 0.0, None)]).reasons


def test_the_subject_of_a_certificate_is_whole(tmp_path: Path) -> None:
    subject = "".join(f"/OU={letter * 60}" for letter in "abcd")
    new = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2", "-subj", subject)
    openssl("req", "-x509", *new, "-keyout", tmp_path / "key", "-out", tmp_path / "crt")
    certificate = parse_certificate(der(tmp_path / "crt"))
    assert certificate.subject == certificate.issuer == subject[1:].replace("/", ",")
    assert shorten(certificate.subject) == certificate.subject[: LONGEST_SUBJECT - 3] + "..."
