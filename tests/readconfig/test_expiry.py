"""What is said of certificates before they expire."""

import asyncio
import time

import pytest

from gateway.events import CertificateExpires
from gateway.readconfig import expiry
from gateway.readconfig.expiry import about_certificates, certificates, keep_looking
from gateway.tls.contexts import Expiry, Loaded
from gateway.tls.settings import SecretFile, Secured, ServerTls
from gateway.tls.store import TlsStore

NOW = 1_800_000_000.0
SETTINGS = ServerTls(SecretFile("server.crt"), SecretFile("server.key"))


def store(**days: float) -> TlsStore:
    """Of one listener whose files expire after so many days."""
    made = TlsStore()
    expiries = tuple(Expiry(key, f"{key}.pem", f"CN={key}", NOW + left * 86400) for key, left in days.items())
    made.adopt({Secured("listen remote", "gateway.toml:3", SETTINGS): Loaded(None, expiries, b"")})
    return made


def test_the_status_names_user_key_file_and_end() -> None:
    (one,) = certificates(store(certificate=12.25), NOW)
    assert (one.used_by, one.key, one.file, one.subject) == (
        "listen remote", "certificate", "certificate.pem", "CN=certificate",
    )  # fmt: skip
    assert (one.until, one.days_left) == ("2027-01-27", 12.2)


@pytest.mark.parametrize(
    ("days", "level", "what"),
    [
        (31.0, "ok", "the first to expire is crl.pem, on 2027-02-15"),
        (29.0, "fix", "crl.pem expires in 29 days, on 2027-02-13"),
        (-1.0, "fix", "crl.pem has expired, on 2027-01-14"),
    ],
)
def test_doctor_says_what_expires_within_a_month(days: float, level: str, what: str) -> None:
    (finding,) = about_certificates(store(certificate=400.0, crl=days), NOW)
    assert (finding.level, finding.what) == (level, what)
    assert ("gateway.toml:3" in finding.remedy) is (level == "fix")


def test_without_certificates_nothing_is_said() -> None:
    assert list(about_certificates(TlsStore(), NOW)) == []


async def test_a_clock_that_is_set_back_does_not_silence_it(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = asyncio.get_running_loop()
    began, told = loop.time(), []
    wall = lambda: NOW + loop.time() - began - (10 * 86400 if loop.time() - began > 3600 else 0)  # noqa: E731
    monkeypatch.setattr(expiry.time, "time", wall)
    looking = asyncio.create_task(keep_looking(lambda: store(certificate=10.0), told.append))
    await asyncio.sleep(50 * 3600)
    looking.cancel()
    assert len(told) == 3


async def test_an_event_is_told_once_a_day(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = asyncio.get_running_loop()
    monkeypatch.setattr(expiry.time, "time", lambda: NOW + loop.time())
    began, told = loop.time(), []
    looking = asyncio.create_task(keep_looking(lambda: store(certificate=29.0, clients_ca=500.0), told.append))
    await asyncio.sleep(50 * 3600)
    looking.cancel()
    assert [(type(each), each.key) for each in told] == [(CertificateExpires, "certificate")] * 3
    assert loop.time() - began < 51 * 3600
    assert time


def test_doctor_says_what_is_not_valid_yet() -> None:
    made = TlsStore()
    early = Expiry("certificate", "server.crt", "CN=server", NOW + 400 * 86400, NOW + 3600)
    made.adopt({Secured("listen remote", "gateway.toml:3", SETTINGS): Loaded(None, (early,), b"")})
    finding, _ = about_certificates(made, NOW)
    assert (finding.level, finding.about) == ("fix", "listen remote")
    assert finding.what == (
        "server.crt is not valid before 2027-01-15 09:00 UTC, and the clock here says 2027-01-15 08:00 UTC"
    )
    assert "set the clock" in finding.remedy
    assert "gateway.toml:3" in finding.remedy
