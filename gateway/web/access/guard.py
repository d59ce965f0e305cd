"""Authentication and authorization: every HTTP request passes here first.

A page of another site can make a browser send requests to this server: by a host name of its own that resolves to this
address (DNS rebinding), or across sites with the cookie that the browser has. So the Host must be an address,
`localhost` or one of the `hosts`. A request that changes something needs a login, an Origin of ours, and the token of
the session, which only our own pages know. A request that reads from a device is refused to pages of other sites.
A program with a token of its own needs none of these three: a browser never adds that header by itself, and a page of
another site may not make it.
"""

import asyncio
import hashlib
import hmac
import re
import secrets
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Final, Literal
from urllib.parse import quote, urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

from gateway.events import Emit, WebDenied
from gateway.readconfig.page_users import Role, User, is_user_name
from gateway.request import Caller
from gateway.web.access.sessions import Sessions
from gateway.web.access.tokens import Tokens, bearer_of
from gateway.web.access.user_table import UserTable
from gateway.web.front.bodies import FORM, FORM_TYPE, take_body, with_long_body
from gateway.web.front.problems import Handler, ProblemError
from gateway.web.front.settings import WebSettings
from gateway.web.text.cookies import cookie

#: What a request needs: nothing, to be allowed to read, to be logged in, to be an operator.
Need = Literal["nothing", "metrics", "reading", "page", "login", "operator"]

#: A Host: an IPv6 address in brackets, or an IPv4 address or a name; and its port.
_HOST: Final = re.compile(r"(?:\[([0-9A-Fa-f:.]{2,45})\]|([0-9A-Za-z._-]{1,253}))(?::[0-9]{1,5})?")
_UNSAFE: Final = frozenset({"POST", "PUT", "PATCH", "DELETE"})
#: Where a browser says that a request comes from, if it comes from a page of another site.
_ELSEWHERE: Final = frozenset({"cross-site", "same-site"})
#: What an address may choose for any page: its language and its theme.
_CHOICES: Final = ("lang", "theme")
#: What only a proxy adds: the client is elsewhere, although the connection comes from this machine.
_OF_PROXIES: Final = (
    *("X-Forwarded-For", "X-Forwarded-User", "X-Forwarded-Host", "X-Forwarded-Proto"),
    *("X-Real-IP", "Forwarded", "Via"),
)


@dataclass(frozen=True, slots=True)
class Visitor:
    """The client at the address `host`; if it has logged in, or is a `program` with a token, with `user` and `role`.

    `csrf` is what it must send to change something, if it is no program. `token` is that of its session, if it has one.
    """

    host: str
    may_read: bool = False
    user: str = ""
    role: Role | None = None
    csrf: str = ""
    token: str = ""
    is_local: bool = False
    program: User | None = None
    has_wrong_token: bool = False

    @property
    def client(self) -> str:
        """The visitor's name in the log: `web:anna@10.2.0.7`."""
        return f"web:{self.user}@{self.host}" if self.user else f"web@{self.host}"

    @property
    def caller(self) -> Caller:
        """The caller of the visitor's requests."""
        return Caller(self.client, self.host, share_key=self.host or self.client)


#: Where handlers find the visitor of a request.
VISITOR: Final = web.RequestKey("visitor", Visitor)


class Guard:
    """Admits or refuses requests, by settings, users, sessions and tokens."""

    def __init__(self, settings: WebSettings, table: UserTable, sessions: Sessions, tokens: Tokens, emit: Emit) -> None:
        self._settings = settings
        self._table = table
        self._sessions = sessions
        self._known = frozenset({"localhost", *(host.lower() for host in settings.hosts)})
        self._tokens = tokens
        self._emit = emit
        self._secret = secrets.token_bytes(32)
        self.cookie: Final = "__Host-mbgw" if settings.is_encrypted else "mbgw"

    def middleware(self, needs: Mapping[object, Need], long_bodies: Collection[str] = ()) -> Middleware:
        """Make the middleware that refuses clients by the `needs` of handlers; those without one need `reading`.

        The paths in `long_bodies` take LONGEST_BODY, one request at a time, and only of whom they let in.
        """
        long_turn = asyncio.Lock()

        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            if not _is_ours(request.headers.getall("Host", []), self._known):
                raise ProblemError(421, "this host is not among the hosts of [web]")
            if "Transfer-Encoding" in request.headers:  # chunks of one byte take long, and have no end
                raise ProblemError(411, "a body needs a Content-Length, and is not sent in chunks")
            if request.match_info.http_exception is not None:
                return await handler(request)  # there is no such path, or no such method
            need = needs.get(request.match_info.handler, "reading")
            visitor = self.visitor(request)
            request[VISITOR] = visitor
            if need != "nothing":
                self._check_token(visitor)
            if request.method in _UNSAFE:
                self._check_origin(request, visitor)
                if request.path in long_bodies:
                    self._check(request, visitor, need)
                    async with long_turn:
                        request = await with_long_body(request)
                else:
                    await take_body(request)
            self._check(request, visitor, need)
            if need in ("login", "operator") and visitor.program is None:
                await _check_csrf(request, visitor)
            return await handler(request)

        return guard

    def visitor(self, request: web.Request) -> Visitor:
        """Find the client of a request: by the user that a proxy names, its session, its token, or its address."""
        address = _address(request.remote or "")
        host = str(address or request.remote or "")
        by_proxy = address is not None and any(address in network for network in self._settings.proxy)
        name = request.headers.get("X-Forwarded-User", "")
        if by_proxy and is_user_name(name):
            known = self._table.users.get(name)
            return Visitor(host, True, name, known.role if known else "viewer", self._csrf_of(name))
        token = cookie(request, self.cookie)
        session = self._sessions.find(token, self._table.users, asyncio.get_running_loop().time()) if token else None
        if session is not None:
            session.used = asyncio.get_running_loop().time()
            return Visitor(host, True, session.user.name, session.user.role, session.csrf, token)
        if bearer := bearer_of(request):
            program = self._tokens.program(bearer)
            if program is not None:
                csrf = self._csrf_of(program.hash)
                return Visitor(host, True, program.name, program.role, csrf, program=program)
            may_read = self._tokens.may_read(bearer)
            return Visitor(host, may_read, has_wrong_token=not may_read)
        is_local = address is not None and address.is_loopback and not by_proxy
        is_local = is_local and not any(header in request.headers for header in _OF_PROXIES)
        return Visitor(host, is_local, is_local=is_local)

    def is_valid(self, visitor: Visitor) -> bool:
        """Return whether a visitor with a session or a token of its own still has it."""
        now = asyncio.get_running_loop().time()
        if visitor.program is not None:
            return self._tokens.is_valid(visitor.program)
        return not visitor.token or self._sessions.find(visitor.token, self._table.users, now) is not None

    def _check_token(self, visitor: Visitor) -> None:
        """Refuse a wrong token, whatever the address may do without one; and tell who begins to use a right one."""
        if visitor.has_wrong_token:
            raise self._tokens.refusal(visitor.host, visitor.client)
        if visitor.program is not None:
            self._tokens.note_use(visitor.program, visitor.host, f"web@{visitor.host}")

    def _check(self, request: web.Request, visitor: Visitor, need: Need) -> None:
        if need == "nothing":
            return
        if need in ("login", "operator"):
            if not visitor.user:
                raise _unauthorized("log in first, or send a token with a role")
            if need == "operator" and visitor.role != "operator":
                self._emit(WebDenied(visitor.client, str(visitor.role), request.method, _shape(request)))
                raise ProblemError(403, f"{visitor.user} is a {visitor.role}, and this needs the role operator")
            return
        if not visitor.may_read or (need == "metrics" and visitor.is_local and self._settings.token):
            if need == "page":
                # The login is shown as the page would have been.
                shown = "".join(f"&{name}={quote(request.query[name])}" for name in _CHOICES if name in request.query)
                raise web.HTTPSeeOther(f"/login?next={quote(request.path_qs, safe='')}{shown}")
            raise _unauthorized("the token, or a login, is needed")
        if request.headers.get("Sec-Fetch-Site") == "cross-site" and need == "reading":
            raise ProblemError(403, "pages of other sites get no answer")

    def _check_origin(self, request: web.Request, visitor: Visitor) -> None:
        """Check that a request that changes something comes from a page of ours, or from a program.

        A proxy may add the token of a program to what browsers send.
        """
        if visitor.program is not None:
            if request.headers.get("Sec-Fetch-Site") in _ELSEWHERE:
                raise ProblemError(403, "pages of other sites change nothing, with the token of a program neither")
            return
        origin = urlsplit(request.headers.get("Origin", ""))
        is_same = origin.netloc.lower() == request.host.lower()
        address = _address(request.remote or "")
        by_proxy = address is not None and any(address in network for network in self._settings.proxy)
        if origin.scheme not in ("http", "https") or not (
            is_same or (by_proxy and origin.hostname in self._known - {"localhost"})
        ):
            what = "the Origin of a POST or PUT must be that of this page"
            raise ProblemError(403, what if request.cookies else f"{what}; a program sends its token instead")

    def _csrf_of(self, name: str) -> str:
        return hmac.digest(self._secret, name.encode(), hashlib.sha256).hex()


async def _check_csrf(request: web.Request, visitor: Visitor) -> None:
    """Check the token in the header, or in the field `csrf` of a form."""
    given = request.headers.get("X-CSRF-Token", "")
    if not given and request.content_type == FORM_TYPE:
        form = request[FORM] if FORM in request else await request.post()
        given = str(form.get("csrf", ""))
    if not hmac.compare_digest(given.encode(errors="surrogateescape"), visitor.csrf.encode()):
        raise ProblemError(403, "X-CSRF-Token must be that of the session; GET /api/v1/session tells it")


def _shape(request: web.Request) -> str:
    """Return the path of a request without what is particular in it: the log has few different ones."""
    resource = request.match_info.route.resource
    return "" if resource is None else resource.canonical


def _unauthorized(detail: str) -> ProblemError:
    return ProblemError(401, detail, {"WWW-Authenticate": "Bearer"})


def _is_ours(hosts: Sequence[str], known: frozenset[str]) -> bool:
    """Return whether there is one Host, and it is an address or one of the `known` names, with or without a port."""
    found = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
    if found is None:
        return False
    address, name = found.groups()
    return (name or "").lower() in known or _address(address or name) is not None


def _address(host: str) -> IPv4Address | IPv6Address | None:
    try:
        address = ip_address(host.partition("%")[0])
    except ValueError:
        return None
    return (address.ipv4_mapped or address) if isinstance(address, IPv6Address) else address
