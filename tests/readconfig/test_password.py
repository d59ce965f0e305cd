"""The password for a broker, as its file has it."""

import pytest

from gateway.errors import BrokerError
from gateway.readconfig.password import read_password
from gateway.tls.settings import SecretFile


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "password"
    path.touch(mode=0o600)
    return path


@pytest.mark.parametrize("content", ["söcret\r\nmore", "söcret\n", "söcret"])
def test_a_password_is_the_first_line_of_its_file(file, content):
    file.write_text(content, encoding="utf-8")
    assert read_password(SecretFile(str(file))) == "söcret"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("söcret\n".encode("latin-1"), "the password is not UTF-8 text"),
        (b"x" * 1025 + b"\n", "the password has more than 1024 bytes"),
    ],
)
def test_no_other_password_is_sent_than_the_file_has(file, content, reason):
    file.write_bytes(content)
    with pytest.raises(BrokerError, match=f"^{file}: {reason}$"):
        read_password(SecretFile(str(file)))


def test_the_longest_password_is_taken(file):
    file.write_bytes(b"x" * 1024 + b"\n")
    assert read_password(SecretFile(str(file))) == "x" * 1024
