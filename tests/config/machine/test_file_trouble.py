"""What keeps the service from reading a config file that root can read."""

import pytest

from gateway.config.machine.file_text import file_trouble


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "gateway.toml"
    file.touch()
    return file


def test_a_file_that_not_everybody_may_read(file):
    file.chmod(0o640)
    said = f"{file}: warning: the service may not be able to read this file\n  help: sudo chmod 644 {file}"
    assert str(file_trouble(str(file), file.parent)) == said


def test_a_file_that_everybody_may_read(file):
    file.chmod(0o644)
    assert file_trouble(str(file), file.parent) is None


def test_a_file_elsewhere_is_not_that_of_the_service(file):
    file.chmod(0o600)
    assert file_trouble(str(file)) is None
