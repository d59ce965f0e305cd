"""Sessions and wrong passwords: how long they count, and how many there can be."""

import pytest

from gateway.readconfig.page_users import User
from gateway.web.access.sessions import (
    FAILURES_COUNT_FOR,
    MOST_ADDRESSES,
    MOST_FAILURES,
    MOST_FAILURES_OF_ONE_USER,
    MOST_OF_ONE_USER,
    MOST_OWN,
    MOST_SESSIONS,
    OWN_FOR,
    Attempts,
    Sessions,
)
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
    attempts.succeeded("10.0.0.1", ANNA, 0.5)
    assert attempts.wait("10.0.0.1", None, 1.0) == 0


def test_many_addresses_do_not_guess_the_password_of_one_user():
    attempts = Attempts()
    for number in range(MOST_FAILURES_OF_ONE_USER):
        assert attempts.wait("10.9.9.9", ANNA, 0.0) == 0
        attempts.failed(f"10.0.0.{number}", ANNA, 0.0)
    assert attempts.wait("10.9.9.9", ANNA, 1.0) == FAILURES_COUNT_FOR - 1
    assert attempts.wait("10.9.9.9", User("vera", "viewer", CHEAP_HASH), 1.0) == 0


VERA = User("vera", "viewer", CHEAP_HASH)


def guess(attempts, user, now, address="10.66.0.%d", number=1000):
    """How many of so many attempts with a wrong password, each from an address of its own, were looked at."""
    looked_at = 0
    for each in range(number):
        where = address % each if "%" in address else address
        if not attempts.wait(where, user, now):
            attempts.failed(where, user, now)
            looked_at += 1
    return looked_at


@pytest.mark.parametrize("address", ["10.0.0.1", "127.0.0.1"])
def test_nobody_elsewhere_keeps_a_user_from_logging_in_at_an_address_of_his_own(address):
    attempts = Attempts()
    if address == "10.0.0.1":
        attempts.succeeded(address, ANNA, 0.0)
    for now in range(0, 7 * 24 * 3600, 3600):
        assert guess(attempts, ANNA, now) == MOST_FAILURES_OF_ONE_USER
        assert attempts.wait("10.0.0.2", ANNA, now) > 0
        assert attempts.wait(address, ANNA, now) == 0


@pytest.mark.parametrize("address", ["10.0.0.1", "127.0.0.1"])
@pytest.mark.parametrize("other", [None, VERA])
def test_who_guesses_other_passwords_at_his_address_does_not_keep_a_user_out(address, other):
    """Behind a proxy, and through `ssh -L`, all have one address."""
    attempts = Attempts()
    if address == "10.0.0.1":
        attempts.succeeded(address, ANNA, 0.0)
    assert guess(attempts, other, 1.0, address) == MOST_FAILURES
    assert attempts.wait(address, other, 2.0) > 0
    assert attempts.wait(address, ANNA, 2.0) == 0


def test_an_address_is_a_users_own_for_a_while_and_nobody_elses():
    attempts = Attempts()
    attempts.succeeded("10.0.0.1", ANNA, 0.0)
    guess(attempts, VERA, 1.0)
    assert attempts.wait("10.0.0.1", VERA, 2.0) > 0
    guess(attempts, ANNA, OWN_FOR)
    assert attempts.wait("10.0.0.1", ANNA, OWN_FOR) > 0


def test_at_an_address_of_his_own_a_users_password_is_not_guessed_either():
    """Not even by somebody there who logs in as himself between guesses."""
    attempts = Attempts()
    attempts.succeeded("10.0.0.1", ANNA, 0.0)
    looked_at = 0
    for _ in range(100):
        looked_at += guess(attempts, ANNA, 1.0, "10.0.0.1", MOST_FAILURES - 1)
        attempts.succeeded("10.0.0.1", VERA, 1.0)
    assert looked_at == MOST_FAILURES
    assert attempts.wait("10.0.0.2", ANNA, 1.0) == 0


def test_addresses_of_ones_own_have_a_bound():
    attempts = Attempts()
    for number in range(MOST_OWN + 1):
        attempts.succeeded(f"10.0.0.{number}", ANNA, float(number))
    guess(attempts, ANNA, 100.0)
    waits = [attempts.wait(f"10.0.0.{number}", ANNA, 100.0) for number in range(MOST_OWN + 1)]
    assert [wait > 0 for wait in waits] == [True] + [False] * MOST_OWN


def test_addresses_that_are_remembered_have_a_bound():
    attempts = Attempts()
    for number in range(MOST_ADDRESSES + 10):
        attempts.failed(f"address {number}", None, number)
    assert len(attempts._of_addresses) == MOST_ADDRESSES
    assert f"address {MOST_ADDRESSES + 9}" in attempts._of_addresses
    assert "address 0" not in attempts._of_addresses
