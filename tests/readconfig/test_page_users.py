"""The file with the users of the web page."""

import os
import stat
import threading

import pytest

from gateway.errors import UsersError
from gateway.readconfig.page_users import (
    User,
    changing_users,
    hashed,
    is_password,
    is_user_name,
    parse_users,
    password_trouble,
    read_users,
)
from kit.browser import CHEAP_HASH

ANNA = User("anna", "operator", CHEAP_HASH)


def test_a_password_is_known_again_and_never_kept():
    kept = hashed("correct horse")
    assert "correct" not in kept
    assert kept != hashed("correct horse")
    (user,) = parse_users(f"anna:viewer:{kept}\n", "users").values()
    assert is_password("correct horse", user)
    assert not is_password("correct horsf", user)
    assert not is_password("correct horse", None)


def test_empty_lines_and_comments_mean_nothing():
    assert parse_users(f"# us\n\nanna:operator:{CHEAP_HASH}\n  \n", "users") == {"anna": ANNA}


@pytest.mark.parametrize(
    "line",
    [
        "anna",
        "anna:operator",
        "anna:operator:secret",
        f"anna:root:{CHEAP_HASH}",
        f":viewer:{CHEAP_HASH}",
        f"an na:viewer:{CHEAP_HASH}",
        f"anna:viewer:{CHEAP_HASH}x",
        f"anna:viewer:{CHEAP_HASH.replace('ln=1,', 'ln=30,')}",
        f"anna:viewer:{CHEAP_HASH.replace('ln=1,', 'ln=0,')}",
        f"anna:viewer:{CHEAP_HASH.replace('r=1', 'r=99')}",
        f"anna:viewer:{CHEAP_HASH.replace('PQkV', '')}",
    ],
)
def test_a_line_that_is_no_user_is_named_and_not_repeated(line):
    with pytest.raises(UsersError, match=r"^users:2: this is no user") as error:
        parse_users(f"\n{line}\n", "users")
    assert "scrypt" not in str(error.value)
    assert "secret" not in str(error.value)


def test_a_name_is_there_once():
    with pytest.raises(UsersError, match=r"users:2: anna is there twice"):
        parse_users(f"anna:viewer:{CHEAP_HASH}\n" * 2, "users")


@pytest.mark.parametrize(
    ("password", "trouble"), [("1234567", "8 characters"), ("12345678", ""), ("é" * 513, "1024 bytes")]
)
def test_a_password_has_a_shortest_and_a_longest_length(password, trouble):
    assert trouble in password_trouble(password)
    assert bool(trouble) == bool(password_trouble(password))


@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("a", True),
        ("a.b@c-d_1", True),
        ("", False),
        (".a", False),
        ("a:b", False),
        ("a" * 65, False),
        ("é", False),
        ("a\n", False),
    ],
)
def test_names(name, is_one):
    assert is_user_name(name) is is_one


def test_a_new_file_is_for_its_owner_only(tmp_path):
    old = os.umask(0)
    try:
        with changing_users(tmp_path / "users") as users:
            users["anna"] = ANNA
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "users").stat().st_mode) == 0o600
    assert read_users(tmp_path / "users") == {"anna": ANNA}
    assert [path.name for path in tmp_path.iterdir()] == ["users"]


def test_a_file_keeps_its_group_rights_and_loses_those_of_others(tmp_path):
    file = tmp_path / "users"
    file.write_text("")
    file.chmod(0o664)
    with changing_users(file) as users:
        users["anna"] = ANNA
    assert stat.S_IMODE(file.stat().st_mode) == 0o640


def test_the_file_behind_a_link_is_changed_and_the_link_stays(tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "users").symlink_to(tmp_path / "there" / "users")
    with changing_users(tmp_path / "users") as users:
        users["anna"] = ANNA
    assert (tmp_path / "users").is_symlink()
    assert read_users(tmp_path / "there" / "users") == {"anna": ANNA}


def test_a_file_that_cannot_be_understood_is_left_alone(tmp_path):
    file = tmp_path / "users"
    file.write_text("nonsense\n")
    with pytest.raises(UsersError), changing_users(file):
        pass
    assert file.read_text() == "nonsense\n"


def test_of_two_changes_at_once_none_is_lost(tmp_path):
    file, first_is_in = tmp_path / "users", threading.Event()

    def add_vera():
        first_is_in.wait()
        with changing_users(file) as users:
            users["vera"] = User("vera", "viewer", CHEAP_HASH)

    other = threading.Thread(target=add_vera)
    other.start()
    with changing_users(file) as users:
        first_is_in.set()
        other.join(0.2)
        users["anna"] = ANNA
    other.join()
    assert set(read_users(file)) == {"anna", "vera"}
