"""The first steps: their commands work as they stand, with what is there."""

import re
import subprocess
from types import SimpleNamespace

import pytest

from gateway.cli.kit import first_steps as module
from gateway.cli.kit.first_steps import first_steps
from gateway.cli.main import main
from gateway.config.load import load

ADAPTER = "/dev/serial/by-id/usb-FTDI_A1-if00-port0"


@pytest.fixture(autouse=True)
def _somewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def ports(monkeypatch):
    """Sets which serial ports there are."""

    def there_are(*paths):
        monkeypatch.setattr(module, "list_serial_ports", lambda: [SimpleNamespace(path=path) for path in paths])

    there_are()
    return there_are


def commands(said):
    """The commands of ours that stand in a line of their own."""
    return re.findall(r"^(?:sudo )?modbus-gateway (.*)$", said, re.MULTILINE)


def test_there_are_three_of_them_by_hand_and_with_a_service(tmp_path, ports):
    config = tmp_path / "service.toml"
    by_hand = first_steps(config)
    config.touch()
    for said in (by_hand, first_steps(config)):
        assert re.findall(r"^(\d)\. ", said, re.MULTILINE) == ["1", "2", "3"]


def test_the_config_that_a_shell_writes_is_right_and_has_the_page(tmp_path, ports):
    ports(ADAPTER)
    said = first_steps(tmp_path / "none.toml")
    writes = re.search(r"^cat > .*?^END$", said, re.MULTILINE | re.DOTALL)[0]
    subprocess.run(["sh", "-c", writes], check=True)
    loaded = load("gateway.toml")
    assert loaded.errors == ()
    assert (loaded.config.line[0].port, str(loaded.config.web.bind)) == (ADAPTER, "http://127.0.0.1:8502")
    assert commands(said)[-2:] == ["check gateway.toml", "run gateway.toml"]


def test_a_config_that_is_there_already_is_not_overwritten(tmp_path, ports):
    (tmp_path / "gateway.toml").touch()
    assert "cat >" not in first_steps(tmp_path / "none.toml")


def test_each_command_is_one_that_the_parser_knows(tmp_path, ports, monkeypatch):
    config = tmp_path / "service.toml"
    by_hand = commands(first_steps(config))
    config.touch()
    ran = []
    monkeypatch.setattr("gateway.cli.main._run", lambda args: ran.append(args.verb))
    for command in (*by_hand, *commands(first_steps(config))):
        main(command.split())
    assert ran == ["demo", "ports", "scan", "check", "run", "ports", "scan", "check", "reload"]


def test_an_adapter_comes_before_a_port_that_is_built_in(tmp_path, ports):
    ports("/dev/ttyS0", ADAPTER)
    assert f"scan 1-20 --port {ADAPTER} " in first_steps(tmp_path / "none.toml")
    ports("/dev/ttyS0")
    assert "scan 1-20 --port /dev/ttyS0 " in first_steps(tmp_path / "none.toml")


def test_with_a_service_the_page_is_the_one_of_its_config(tmp_path, ports):
    config = tmp_path / "service.toml"
    config.write_text('[web]\nbind = "http://127.0.0.1:8600"\n')
    said = first_steps(config)
    assert "1. Open the page: http://127.0.0.1:8600\n" in said
    assert "ssh -N -L 8600:127.0.0.1:8600 " in said
    config.write_text('[web]\nbind = "https://10.2.0.1"\n')
    assert "ssh" not in first_steps(config)


@pytest.mark.parametrize("text", ["", "[web", "[web]\nbind = 3\n"])
def test_a_config_without_a_page_gets_one(tmp_path, ports, text):
    config = tmp_path / "service.toml"
    config.write_text(text)
    assert '[web]\nbind = "http://127.0.0.1:8502"' in first_steps(config)


def test_without_the_libraries_of_the_page_it_says_how_to_install_them(tmp_path, ports, monkeypatch):
    monkeypatch.setattr(module, "missing_library", lambda extra: "aiohttp")
    said = first_steps(tmp_path / "none.toml")
    assert "aiohttp is not installed" in said
    assert "[web]\n" not in said
