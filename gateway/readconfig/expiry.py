"""Warns early of certificates and revocation lists that will expire."""

import asyncio
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from math import inf
from typing import Final

from gateway.diagnosis.finding import Finding
from gateway.events import CertificateExpires, Emit
from gateway.tls.contexts import find_too_early
from gateway.tls.status import EARLY, CertificateStatus
from gateway.tls.store import TlsStore

#: Files are looked at every hour (STEP, in seconds): a reload may bring others.
STEP: Final = 3600.0
DAY: Final = 86_400.0


def certificates(contexts: TlsStore, now: float) -> Iterator[CertificateStatus]:
    """Yield every certificate and revocation list in use; `now` is in seconds since 1970."""
    for secured, expiry in contexts.expiries():
        until = datetime.fromtimestamp(expiry.at, UTC).strftime("%Y-%m-%d")
        left = round((expiry.at - now) / DAY, 1)
        yield CertificateStatus(secured.name, secured.source, expiry.what, expiry.file, expiry.subject, until, left)


async def keep_looking(contexts: Callable[[], TlsStore], emit: Emit) -> None:
    """Emit CertificateExpires once a day for each file that expires soon, until cancelled."""
    loop = asyncio.get_running_loop()
    told_at: dict[tuple[str, str, str], float] = {}
    while True:
        now, passed = time.time(), loop.time()  # the loop's clock is never set
        for each in certificates(contexts(), now):
            place = each.file, each.subject, each.until
            if each.days_left < EARLY and passed - told_at.get(place, -inf) >= DAY:
                told_at[place] = passed
                emit(CertificateExpires(each.used_by, each.key, each.file, each.subject, each.days_left))
        await asyncio.sleep(STEP)


def about_certificates(contexts: TlsStore, now: float) -> Iterator[Finding]:
    """Yield findings for `doctor`: what is not valid yet, what expires soon, or when the first one does."""
    for secured, expiry in contexts.expiries():
        for said in find_too_early([expiry], now):
            remedy = (
                f"set the clock of this machine, or {secured.source}: put another file in its place ({expiry.what})"
            )
            yield Finding("fix", secured.name, said, remedy)
    known = sorted(certificates(contexts, now), key=lambda each: each.days_left)
    soon = [each for each in known if each.days_left < EARLY]
    for each in soon:
        what = f"{each.file} has expired" if each.days_left < 0 else f"{each.file} expires in {each.days_left:.0f} days"
        remedy = f"{each.source}: put another file in its place ({each.key}), then modbus-gateway reload"
        yield Finding("fix", each.used_by, f"{what}, on {each.until}", remedy)
    if known and not soon:
        yield Finding("ok", "certificates", f"the first to expire is {known[0].file}, on {known[0].until}")
