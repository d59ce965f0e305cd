"""`user`: who may log in at the web page."""

import io
import json

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, WRONG_USAGE, main
from gateway.readconfig.page_users import is_password, read_users, token_hash


@pytest.fixture
def users(tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.readconfig.page_users._COST", (1, 1, 1))
    return tmp_path / "users"


def user(monkeypatch, users, *words: str, typed: str = "correct horse\n") -> int:
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    return main(["user", *words, "--file", str(users)])


def test_users_are_added_listed_changed_and_removed(monkeypatch, users, capsys):
    assert user(monkeypatch, users, "add", "anna", "--role", "operator") == FINE
    assert user(monkeypatch, users, "add", "vera") == FINE
    assert user(monkeypatch, users, "password", "anna", typed="battery staple\n") == FINE
    anna = read_users(users)["anna"]
    assert anna.role == "operator"
    assert is_password("battery staple", anna)
    capsys.readouterr()
    assert user(monkeypatch, users, "list") == FINE
    assert capsys.readouterr().out == "USER  ROLE      PROVED BY\nanna  operator  password\nvera  viewer    password\n"
    assert user(monkeypatch, users, "remove", "vera") == FINE
    capsys.readouterr()
    assert user(monkeypatch, users, "list", "--json") == FINE
    assert json.loads(capsys.readouterr().out) == [{"user": "anna", "role": "operator", "token": False}]


@pytest.mark.parametrize(
    ("words", "typed", "said"),
    [
        (("add", "an:na"), "correct horse\n", "not a valid user name"),
        (("add", "anna"), "correct horse\n", "anna is there already"),
        (("add", "vera"), "short\n", "8 characters"),
        (("add", "vera"), "", "8 characters"),
        (("remove", "ana"), "", 'did you mean "anna"?'),
        (("password", "otto"), "correct horse\n", "there is no user otto"),
    ],
)
def test_what_cannot_be_meant_changes_nothing(monkeypatch, users, capsys, words, typed, said):
    user(monkeypatch, users, "add", "anna")
    before = users.read_text()
    capsys.readouterr()
    assert user(monkeypatch, users, *words, typed=typed) == WRONG_USAGE
    error = capsys.readouterr().err
    assert said in error
    assert typed.strip() not in error or not typed.strip()
    assert users.read_text() == before


def test_a_folder_that_is_missing_is_named(monkeypatch, users, capsys):
    assert user(monkeypatch, users.parent / "missing" / "users", "add", "anna") == PROBLEM_FOUND
    assert "missing" in capsys.readouterr().err


def test_on_a_terminal_the_password_is_typed_twice(monkeypatch, users, capsys):
    typed = iter(["correct horse", "correct horsf"])
    monkeypatch.setattr("getpass.getpass", lambda prompt: next(typed))
    terminal = io.StringIO()
    terminal.isatty = lambda: True
    monkeypatch.setattr("sys.stdin", terminal)
    assert main(["user", "add", "anna", "--file", str(users)]) == WRONG_USAGE
    assert "the two passwords differ" in capsys.readouterr().err
    assert not users.exists()


def test_without_an_option_the_config_of_the_service_says_where(monkeypatch, users, tmp_path, capsys):
    config = tmp_path / "gateway.toml"
    config.write_text(f'[web]\nbind = "http://127.0.0.1:0"\nusers = "{users}"\n')
    monkeypatch.setattr("gateway.cli.verbs.user.DEFAULT_CONFIG", str(config))
    assert main(["user", "list"]) == FINE
    assert capsys.readouterr().out == f"{users} has no users\n"


@pytest.mark.parametrize(
    "words", [("mes", "--token", "--role", "operator"), ("add", "mes", "--token", "--role=operator")]
)
def test_a_token_is_printed_once_and_only_its_hash_is_kept(monkeypatch, users, capsys, words):
    assert user(monkeypatch, users, *words, typed="") == FINE
    out, err = capsys.readouterr()
    token = out.removesuffix("\n")
    assert token_hash(token) == read_users(users)["mes"].hash
    assert token not in err
    assert "mes (operator) was added" in err
    assert token not in users.read_text()
    assert user(monkeypatch, users, "list") == FINE
    assert capsys.readouterr().out == "USER  ROLE      PROVED BY\nmes   operator  token\n"


def test_a_token_is_for_viewers_unless_told_otherwise_and_is_removed_as_a_user(monkeypatch, users, capsys):
    user(monkeypatch, users, "wall", "--token")
    assert read_users(users)["wall"].role == "viewer"
    assert user(monkeypatch, users, "remove", "wall") == FINE
    assert dict(read_users(users)) == {}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("mes", "--token"), "mes is there already"),
        (("add", "mes"), "user remove mes"),
        (("password", "mes"), "mes has a token, no password"),
        (("a:b", "--token"), "not a valid user name"),
    ],
)
def test_a_token_is_not_replaced_by_the_way(monkeypatch, users, capsys, words, said):
    user(monkeypatch, users, "mes", "--token")
    before = users.read_text()
    capsys.readouterr()
    assert user(monkeypatch, users, *words) == WRONG_USAGE
    out, err = capsys.readouterr()
    assert out == ""
    assert said in err
    assert users.read_text() == before
