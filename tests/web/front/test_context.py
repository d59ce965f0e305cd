"""The TLS context for connections to the page: that of the last reload, and one that keeps few sessions."""

import asyncio
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from gateway.config.plan.settings import WebPlan
from gateway.config.values.address import Address
from gateway.listeners import kept_sessions
from gateway.tls.settings import SecretFile, ServerTls
from gateway.tls.store import TlsStore, load_all
from gateway.web.front.opening import _context_now
from kit.pki import handshake_without_tickets, pki


def web(folder: Path) -> WebPlan:
    """A page with the certificate of `pki` in this folder."""
    files = [folder / name for name in ("server.crt", "server.key")]
    for file in files:
        shutil.copy(pki() / file.name, file)
    tls = ServerTls(*[SecretFile(str(file)) for file in files])
    return WebPlan(Address("https", "127.0.0.1", 8502), (), None, tls=tls)


@pytest.mark.parametrize("is_renamed", [False, True])
def test_sessions_of_the_page_are_forgotten_when_they_are_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, is_renamed: bool
) -> None:
    """Also after a reload that names other files, which the page uses after a restart only."""
    monkeypatch.setattr(kept_sessions, "MOST_SESSIONS", 2)

    async def scenario() -> None:
        contexts, plan = TlsStore(), web(tmp_path)
        context = _context_now(plan, contexts)
        assert context is not None
        before = context()
        if is_renamed:
            assert plan.tls is not None
            (tmp_path / "new.crt").write_bytes((tmp_path / "server.crt").read_bytes())
            renamed = replace(plan, tls=replace(plan.tls, certificate=SecretFile(str(tmp_path / "new.crt"))))
            contexts.adopt(load_all(renamed.secured))
        for number in range(3):
            assert context() is before
            handshake_without_tickets(before)
            assert before.session_stats()["number"] == number + 1
        assert context() is before
        while context() is before:  # noqa: ASYNC110 - files are read in a thread
            await asyncio.sleep(0.01)
        assert context().session_stats()["number"] == 0
        assert len({secured.settings for secured, _ in contexts.expiries()}) == 1

    asyncio.run(asyncio.wait_for(scenario(), 60.0))


def test_the_page_uses_what_a_reload_has_loaded(tmp_path: Path) -> None:
    contexts, plan = TlsStore(), web(tmp_path)
    context = _context_now(plan, contexts)
    assert context is not None
    before = context()
    contexts.adopt(load_all(plan.secured))
    assert context() is not before
