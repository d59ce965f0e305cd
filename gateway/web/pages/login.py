"""Login and logout."""

import asyncio
from math import ceil
from typing import Final

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.events import WebLogin, WebLoginFailed
from gateway.listeners.share_keys import ShareKeys
from gateway.readconfig.page_users import LONGEST_PASSWORD, is_password
from gateway.web.access.guard import VISITOR, Guard, Visitor
from gateway.web.access.sessions import LONGEST_SESSION, Attempts, Sessions
from gateway.web.access.user_table import UserTable
from gateway.web.api.operations import json_of
from gateway.web.api.session import session_of
from gateway.web.front.problems import ProblemError
from gateway.web.front.settings import WebSettings
from gateway.web.pages.addresses import see_other
from gateway.web.pages.page import Page, Shown, route
from gateway.web.text.words import N_

#: Logins that wait at a time: each of them takes some tenths of a second of one processor.
MOST_LOGINS: Final = 8


class LoginPage(Page):
    """The handlers of `/login` and `/logout`."""

    def __init__(
        self,
        shown: Shown,
        settings: WebSettings,
        guard: Guard,
        table: UserTable,
        sessions: Sessions,
    ) -> None:
        super().__init__(shown)
        self._settings = settings
        self._emit = shown.operator.running.emit
        self._guard = guard
        self._table = table
        self._sessions = sessions
        self._attempts = Attempts()
        self._share_keys = ShareKeys()
        self._logins = 0
        self._one_login_at_a_time = asyncio.Lock()

    @route("GET", "/login", "nothing")
    async def login_page(self, request: web.Request) -> web.Response:
        """Show the form."""
        return await self._login_page(request)

    @route("POST", "/login", "nothing")
    async def login(self, request: web.Request) -> web.Response:
        """Log in with the fields `user` and `password`. Programs that accept JSON get the session."""
        form, now = await request.post(), asyncio.get_running_loop().time
        name, password = str(form.get("user", "")), str(form.get("password", ""))
        visitor = request[VISITOR]
        address = self._share_keys.of(visitor.host, now())
        user = self._table.users.get(name)
        if wait := self._attempts.wait(address, user, now()):
            return await self._refused(request, 429, N_("Too many wrong passwords: try again later."), ceil(wait))
        if self._logins >= MOST_LOGINS:
            return await self._refused(request, 503, N_("Too many logins at once: try again."), 2)
        self._logins += 1
        try:
            async with self._one_login_at_a_time:
                is_right = await self._is_password(address, name, password)
        finally:
            self._logins -= 1
        user = self._table.users.get(name)
        if user is None or not is_right:
            self._attempts.failed(address, user, now())
            self._emit(WebLoginFailed(visitor.client, user.name if user else ""))
            return await self._refused(request, 401, N_("User or password is wrong."))
        self._attempts.succeeded(address, user, now())
        self._sessions.close(visitor.token)
        token, session = self._sessions.open(user, now())
        self._emit(WebLogin(visitor.client, name))
        known = Visitor(visitor.host, True, name, user.role, session.csrf, token)
        response = (
            web.json_response(body=json_of(session_of(known, may_write=self._settings.write)))
            if _wants_json(request)
            else see_other(_local(str(form.get("next", ""))))
        )
        response.set_cookie(
            self._guard.cookie,
            token,
            max_age=int(LONGEST_SESSION),
            path="/",
            secure=self._settings.is_encrypted,
            httponly=True,
            samesite="Strict",
        )
        return response

    @route("POST", "/logout", "login")
    async def logout(self, request: web.Request) -> web.Response:
        """End the session."""
        visitor = request[VISITOR]
        self._sessions.close(visitor.token)
        response = see_other("/login")
        response.del_cookie(
            self._guard.cookie, path="/", secure=self._settings.is_encrypted, httponly=True, samesite="Strict"
        )
        return response

    async def _is_password(self, address: str, name: str, password: str) -> bool:
        """Check the password; return False without that if other attempts have failed while this one waited."""
        user, now = self._table.users.get(name), asyncio.get_running_loop().time()
        if len(password) > LONGEST_PASSWORD or self._attempts.wait(address, user, now):
            return False
        return await in_thread("web login", is_password, password, user)

    async def _refused(self, request: web.Request, status: int, why: str, wait: int = 0) -> web.Response:
        headers = {"Retry-After": str(wait)} if wait else {}
        if _wants_json(request):
            raise ProblemError(status, why, headers)
        response = await self._login_page(request, why)
        response.set_status(status)
        response.headers.update(headers)
        return response

    async def _login_page(self, request: web.Request, why: str = "") -> web.Response:
        target = _local(request.query.get("next", ""))
        return await self._renderer.page(
            "login.html", request, why=why, target=target, has_users=self._settings.users is not None
        )


def _wants_json(request: web.Request) -> bool:
    return "application/json" in request.headers.get("Accept", "")


def _local(target: str) -> str:
    """Return a path of ours, or else that of the first page: no login leads to another site."""
    is_path = target.startswith("/") and not target.startswith(("//", "/\\")) and target.isprintable()
    return target if is_path and target.isascii() else "/"
