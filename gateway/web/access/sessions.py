"""Sessions, and failed logins. Both are bounded; time is an argument, in seconds."""

import hashlib
import secrets
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gateway.readconfig.page_users import User, Users

#: A session ends after this time without a request, and this long after the login, in seconds.
IDLE_TIME: Final = 3600.0
LONGEST_SESSION: Final = 12 * 3600.0
#: Sessions at a time, of all and of one user; the one that has rested longest makes room.
MOST_SESSIONS: Final = 256
MOST_OF_ONE_USER: Final = 16

#: After this many wrong passwords within this many seconds, the next attempt must wait until the first is that old.
MOST_FAILURES: Final = 5
MOST_FAILURES_OF_ONE_USER: Final = 20
FAILURES_COUNT_FOR: Final = 300.0
#: Addresses whose failures are remembered at a time.
MOST_ADDRESSES: Final = 1000
#: An address is a user's own for this many seconds after a login from there; a user has at most this many.
OWN_FOR: Final = 30 * 24 * 3600.0
MOST_OWN: Final = 8
#: Loopback counts as known for every user.
_HERE: Final = ("127.0.0.1", "::1")


@dataclass(slots=True)
class Session:
    """A login of `user`. A request with its token needs `csrf` too to change anything."""

    user: User
    csrf: str
    began: float
    used: float

    def is_over(self, now: float) -> bool:
        """Return whether it has expired."""
        return now - self.used > IDLE_TIME or now - self.began > LONGEST_SESSION


class Sessions:
    """The sessions, by the hashes of their tokens: nothing that is kept here can be used to log in."""

    def __init__(self) -> None:
        self._sessions: dict[bytes, Session] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    def open(self, user: User, now: float) -> tuple[str, Session]:
        """Open a session, and return its token too."""
        self._make_room(user, now)
        token = secrets.token_urlsafe(32)
        session = self._sessions[_key(token)] = Session(user, secrets.token_urlsafe(32), now, now)
        return token, session

    def find(self, token: str, users: Users, now: float) -> Session | None:
        """Find the session of a token; None if there is none. It has ended if its user is gone, or has changed."""
        session = self._sessions.get(_key(token))
        if session is None:
            return None
        if session.is_over(now) or users.get(session.user.name) != session.user:
            self.close(token)
            return None
        return session

    def close(self, token: str) -> None:
        """End the session."""
        self._sessions.pop(_key(token), None)

    def _make_room(self, user: User, now: float) -> None:
        for key in [key for key, session in self._sessions.items() if session.is_over(now)]:
            del self._sessions[key]
        own = [key for key, session in self._sessions.items() if session.user.name == user.name]
        if len(own) >= MOST_OF_ONE_USER:
            del self._sessions[min(own, key=lambda key: self._sessions[key].used)]
        elif len(self._sessions) >= MOST_SESSIONS:
            del self._sessions[min(self._sessions, key=lambda key: self._sessions[key].used)]


@dataclass(slots=True)
class _OwnAddress:
    """When a user has last logged in from an address, and failed attempts since."""

    used: float
    failures: deque[float] = field(default_factory=lambda: deque(maxlen=MOST_FAILURES))


@dataclass(slots=True)
class Attempts:
    """Wrong passwords, by the address that they came from, and by the user that they were for, if there is one.

    At a user's own addresses only failures of that user count: neither guessing elsewhere, nor guessing other users'
    passwords behind the same proxy, locks the user out.
    """

    _of_addresses: dict[str, deque[float]] = field(default_factory=dict)
    _of_users: dict[str, deque[float]] = field(default_factory=dict)
    _own: dict[str, dict[str, _OwnAddress]] = field(default_factory=dict)

    def wait(self, address: str, user: User | None, now: float) -> float:
        """Return how many seconds to wait before the next attempt; 0 if it may be now."""
        if user is not None and self._is_own(address, user, now):
            own = self._own.get(user.name, {}).get(address)
            return _wait(own.failures if own else None, MOST_FAILURES, now)
        by_address = _wait(self._of_addresses.get(address), MOST_FAILURES, now)
        if user is None:
            return by_address
        return max(by_address, _wait(self._of_users.get(user.name), MOST_FAILURES_OF_ONE_USER, now))

    def failed(self, address: str, user: User | None, now: float) -> None:
        """Note that a wrong password was sent."""
        if address not in self._of_addresses and len(self._of_addresses) >= MOST_ADDRESSES:
            del self._of_addresses[min(self._of_addresses, key=lambda one: self._of_addresses[one][-1])]
        self._of_addresses.setdefault(address, deque(maxlen=MOST_FAILURES)).append(now)
        if user is None:
            return
        if self._is_own(address, user, now):
            self._own_address(address, user, now).failures.append(now)
        else:
            self._of_users.setdefault(user.name, deque(maxlen=MOST_FAILURES_OF_ONE_USER)).append(now)

    def succeeded(self, address: str, user: User, now: float) -> None:
        """Note that the right password was sent."""
        self._of_addresses.pop(address, None)
        own = self._own_address(address, user, now)
        own.used = now
        own.failures.clear()

    def _is_own(self, address: str, user: User, now: float) -> bool:
        own = self._own.get(user.name, {}).get(address)
        return address in _HERE or (own is not None and now - own.used < OWN_FOR)

    def _own_address(self, address: str, user: User, now: float) -> _OwnAddress:
        """Return what is known of an address. A new one replaces the least recently used one if there are too many."""
        all_own = self._own.setdefault(user.name, {})
        if address not in all_own and len(all_own) >= MOST_OWN:
            del all_own[min(all_own, key=lambda one: all_own[one].used)]
        return all_own.setdefault(address, _OwnAddress(now))


def _wait(failures: deque[float] | None, most: int, now: float) -> float:
    if failures is None or len(failures) < most:
        return 0.0
    return max(0.0, failures[0] + FAILURES_COUNT_FOR - now)


def _key(token: str) -> bytes:
    return hashlib.sha256(token.encode(errors="surrogateescape")).digest()
