"""Tokens in the file with the users."""

import re
import time

from gateway.readconfig.page_users import (
    PREFIX,
    User,
    changing_users,
    hashed,
    is_of_token,
    is_password,
    new_token,
    parse_users,
    read_users,
    token_hash,
)
from kit.browser import CHEAP_HASH


def test_no_two_tokens_are_the_same_and_each_has_256_bits():
    made = {new_token() for _ in range(1000)}
    assert len(made) == 1000
    assert all(re.fullmatch(r"mbgw_[A-Za-z0-9_-]{43}", each) for each in made)


def test_what_is_kept_is_the_same_for_the_same_token_only_and_does_not_tell_it():
    token = new_token()
    kept = token_hash(token)
    assert kept == token_hash(token) != token_hash(new_token())
    assert token.removeprefix(PREFIX) not in kept
    assert is_of_token(kept)


def test_what_has_not_the_form_of_a_token_is_none():
    token = new_token()
    for wrong in ("", PREFIX, token[:-1], token + "=", token.replace(PREFIX, "MBGW_"), token + "\n", "é" * 48):
        assert token_hash(wrong) == ""


def test_a_password_is_never_taken_for_a_token():
    assert not is_of_token(hashed("correct horse"))
    assert not is_of_token(CHEAP_HASH)


def test_a_line_of_a_token_is_one_of_a_user_to_versions_that_know_no_tokens(tmp_path):
    """Their rules for a line are those of `parse_users`; they log the program in by its name and its token."""
    token, file = new_token(), tmp_path / "users"
    with changing_users(file) as users:
        users["mes"] = User("mes", "operator", token_hash(token))
    (line,) = file.read_text().splitlines()
    assert re.fullmatch(r"mes:operator:\$scrypt\$ln=\d+,r=\d+,p=\d+\$[A-Za-z0-9+/=]+\$[A-Za-z0-9+/=]{44}", line)
    user = read_users(file)["mes"]
    assert user.is_program
    assert is_password(token, user)
    assert not is_password(new_token(), user)


def test_users_with_a_password_and_programs_with_a_token_stand_in_one_file():
    users = parse_users(f"anna:operator:{CHEAP_HASH}\nmes:viewer:{token_hash(new_token())}\n", "users")
    assert [each.is_program for each in users.values()] == [False, True]


def test_a_hundred_requests_in_a_second_cost_the_loop_a_small_part_of_it():
    token = new_token()
    begun = time.process_time()
    for _ in range(1000):
        token_hash(token)
    spent = time.process_time() - begun
    begun = time.process_time()
    hashed("correct horse")
    assert spent / 1000 < (time.process_time() - begun) / 100, "beside a password it must be nothing"
