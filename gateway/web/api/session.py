"""The session of a visitor, as programs see it."""

from dataclasses import dataclass

from gateway.readconfig.page_users import Role
from gateway.web.access.guard import Visitor


@dataclass(frozen=True, slots=True)
class Session:
    """Who has logged in: `user` is empty without a login. `csrf` is what X-CSRF-Token has to be."""

    user: str
    role: Role | None
    may_write: bool
    csrf: str


def session_of(visitor: Visitor, *, may_write: bool) -> Session:
    """Describe the session of a visitor; values are written only if `may_write`."""
    return Session(visitor.user, visitor.role, may_write and visitor.role == "operator", visitor.csrf)
