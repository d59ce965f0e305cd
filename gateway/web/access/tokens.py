"""Tokens that programs send as `Authorization: Bearer TOKEN`."""

import asyncio
import hmac
from math import ceil

from aiohttp import web

from gateway.events import Emit, WebLogin, WebLoginFailed
from gateway.listeners.share_keys import ShareKeys
from gateway.readconfig.page_users import User, token_hash
from gateway.web.access.sessions import IDLE_TIME, MOST_SESSIONS, Attempts
from gateway.web.access.user_table import UserTable
from gateway.web.front.problems import ProblemError


class Tokens:
    """The token of the config, with which programs read, and those of the users' file, each with a role."""

    def __init__(self, reading: str, table: UserTable, emit: Emit) -> None:
        self._reading = reading.encode()
        self._table = table
        self._emit = emit
        self._wrong = Attempts()
        self._share_keys = ShareKeys()
        #: When each program has last asked, by its hash and its address; in that order.
        self._used: dict[tuple[str, str], float] = {}

    def may_read(self, token: str) -> bool:
        """Return whether this is the token of the config."""
        return bool(self._reading) and hmac.compare_digest(token.encode(errors="surrogateescape"), self._reading)

    def program(self, token: str) -> User | None:
        """Find the program of a token; None if there is none, or none any more.

        How long the look-up takes depends on the hash only, from which nothing follows about the token.
        """
        return self._table.programs.get(token_hash(token))

    def is_valid(self, program: User) -> bool:
        """Return whether a program still has its token and its role."""
        return self._table.programs.get(program.hash) == program

    def note_use(self, program: User, host: str, client: str) -> None:
        """Tell of a program's first request from an address, and of the first after an hour without one."""
        now = asyncio.get_running_loop().time()
        place = program.hash, self._share_keys.of(host, now)
        before = self._used.pop(place, None)
        if before is None and len(self._used) >= MOST_SESSIONS:
            del self._used[next(iter(self._used))]
        self._used[place] = now
        if before is None or now - before > IDLE_TIME:
            self._emit(WebLogin(client, program.name))

    def refusal(self, host: str, client: str) -> ProblemError:
        """Make the answer to a wrong token. After some of them, an address has to wait, and the log is silent.

        A right token is never made to wait: a program is not locked out by another one at its address, and nobody can
        guess a token.
        """
        now = asyncio.get_running_loop().time()
        address = self._share_keys.of(host, now)
        if wait := self._wrong.wait(address, None, now):
            return ProblemError(429, "Too many wrong tokens: try again later.", {"Retry-After": str(ceil(wait))})
        self._wrong.failed(address, None, now)
        self._emit(WebLoginFailed(client, ""))
        return ProblemError(
            401, "the token is wrong, or was removed", {"WWW-Authenticate": 'Bearer error="invalid_token"'}
        )


def bearer_of(request: web.Request) -> str:
    """Return the token that a request sends; empty without one."""
    scheme, _, token = request.headers.get("Authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""
