"""Warnings of `check` about the files that TLS needs."""

import os
import time
from collections.abc import Iterator

from gateway.config.plan.settings import Plan
from gateway.config.problem import Problem, warning
from gateway.errors import TlsError
from gateway.tls.settings import Secured, ServerTls
from gateway.tls.status import EARLY


def certificate_troubles(plan: Plan, file: str) -> Iterator[Problem]:
    """Yield a warning for each file that cannot be used, or not for long. Only the service can see credentials."""
    besides = (one for part in plan.add_ons.values() for one in part.secured)
    for one in (*plan.secured, *besides):
        if not _has_credentials(one) or "CREDENTIALS_DIRECTORY" in os.environ:
            yield from (each.located(file, _line(one), 1) for each in _look_at(one))


def _look_at(one: Secured) -> Iterator[Problem]:
    from gateway.readconfig.expiry import DAY  # noqa: PLC0415 - few configs name such files
    from gateway.tls.contexts import load  # noqa: PLC0415 - loads ssl

    try:
        loaded = load(one.settings)
    except TlsError as error:
        yield warning((), f"{one.name} cannot be used: {error}")
        return
    for said in loaded.warnings:
        yield warning((), f"{one.name}: {said}")
    for expiry in loaded.expiries:
        left = (expiry.at - time.time()) / DAY
        if left < EARLY:
            what = f"{expiry.file} has expired" if left < 0 else f"{expiry.file} expires in {left:.0f} days"
            yield warning((), f"{one.name}: {what}", "put another one in its place, then modbus-gateway reload")


def _has_credentials(one: Secured) -> bool:
    own = one.settings
    others = (own.clients_ca, own.crl) if isinstance(own, ServerTls) else (own.ca,)
    return any(file is not None and file.is_credential for file in (own.certificate, own.key, *others))


def _line(one: Secured) -> int:
    return int(one.source.rpartition(":")[2] or 0)
