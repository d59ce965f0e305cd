"""Sessions and wrong passwords: how long they count, and how many there can be."""

from gateway.web.sessions import (
    FAILURES_COUNT_FOR,
    MOST_ADDRESSES,
    MOST_FAILURES,
    MOST_FAILURES_OF_ONE_USER,
    MOST_OF_ONE_USER,
    MOST_SESSIONS,
    Attempts,
    Sessions,
)
from gateway.web.users import User
from kit.browser import CHEAP_HASH

ANNA = User("anna", "operator", CHEAP_HASH)
USERS = {"anna": ANNA}


def test_a_user_has_some_sessions_and_the_one_that_rested_longest_makes_room():
    sessions = Sessions()
    tokens = [sessions.open(ANNA, now)[0] for now in range(MOST_OF_ONE_USER)]
    sessions.find(tokens[0], USERS, 99.0).used = 99.0
    sessions.open(ANNA, 100.0)
    assert len(sessions) == MOST_OF_ONE_USER
    assert sessions.find(tokens[0], USERS, 100.0)
    assert sessions.find(tokens[1], USERS, 100.0) is None


def test_all_sessions_have_a_bound():
    sessions = Sessions()
    users = [User(f"u{number}", "viewer", CHEAP_HASH) for number in range(MOST_SESSIONS + 1)]
    tokens = [sessions.open(user, now)[0] for now, user in enumerate(users)]
    assert len(sessions) == MOST_SESSIONS
    table = {user.name: user for user in users}
    assert sessions.find(tokens[0], table, 300.0) is None
    assert sessions.find(tokens[-1], table, 300.0)


def test_nothing_that_is_kept_lets_anybody_in():
    sessions = Sessions()
    token, _ = sessions.open(ANNA, 0.0)
    (kept,) = sessions._sessions
    assert token.encode() not in kept
    assert sessions.find(kept.hex(), USERS, 0.0) is None


def test_the_oldest_failure_counts_until_it_is_too_old():
    attempts = Attempts()
    for now in range(MOST_FAILURES):
        assert attempts.wait("10.0.0.1", None, now) == 0
        attempts.failed("10.0.0.1", None, now)
    assert attempts.wait("10.0.0.1", None, 10.0) == FAILURES_COUNT_FOR - 10
    assert attempts.wait("10.0.0.2", None, 10.0) == 0
    assert attempts.wait("10.0.0.1", None, FAILURES_COUNT_FOR) == 0


def test_a_success_forgets_the_failures_of_the_address():
    attempts = Attempts()
    for _ in range(MOST_FAILURES):
        attempts.failed("10.0.0.1", ANNA, 0.0)
    attempts.succeeded("10.0.0.1")
    assert attempts.wait("10.0.0.1", None, 1.0) == 0


def test_many_addresses_do_not_guess_the_password_of_one_user():
    attempts = Attempts()
    for number in range(MOST_FAILURES_OF_ONE_USER):
        assert attempts.wait("10.9.9.9", ANNA, 0.0) == 0
        attempts.failed(f"10.0.0.{number}", ANNA, 0.0)
    assert attempts.wait("10.9.9.9", ANNA, 1.0) == FAILURES_COUNT_FOR - 1
    assert attempts.wait("10.9.9.9", User("vera", "viewer", CHEAP_HASH), 1.0) == 0


def test_addresses_that_are_remembered_have_a_bound():
    attempts = Attempts()
    for number in range(MOST_ADDRESSES + 10):
        attempts.failed(f"address {number}", None, number)
    assert len(attempts._of_addresses) == MOST_ADDRESSES
    assert f"address {MOST_ADDRESSES + 9}" in attempts._of_addresses
    assert "address 0" not in attempts._of_addresses
