"""`import`: what it prints can be used as it is."""

import json
import os

import pytest

from gateway.cli.main import main
from gateway.config.load import parse


def test_a_config_of_mbusd_is_printed(tmp_path, capsys):
    (tmp_path / "mbusd-ttyUSB0.conf").write_text("device = /dev/ttyUSB0\nspeed = 9600\n")
    assert main(["import", "mbusd", str(tmp_path / "mbusd-ttyUSB0.conf")]) == 0
    config = parse(capsys.readouterr().out, port_trouble=lambda _: None).config
    assert [(line.port, line.baud) for line in config.line] == [("/dev/ttyUSB0", 9600)]


def test_a_config_of_modbus_proxy_is_printed(tmp_path, capsys):
    file = tmp_path / "modbus-proxy.yml"
    file.write_text("devices:\n- modbus: {url: 10.0.0.1}\n  listen: {bind: ':502'}\n")
    assert main(["import", "modbus-proxy", str(file)]) == 0
    assert parse(capsys.readouterr().out).config is not None


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "there is no such file"),
        (b"\xff", "this line is not UTF-8 text"),
        (b"speed = 0", "1: speed must be a number"),
    ],
)
def test_a_file_that_cannot_be_used_is_said(content, said, tmp_path, capsys):
    file = tmp_path / "mbusd.conf"
    if content is not None:
        file.write_bytes(content)
    assert main(["import", "mbusd", str(file)]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"modbus-gateway: error: {file}:")
    assert said in printed.err


def test_files_that_are_left_out_are_named_and_the_others_are_printed(tmp_path, capsys):
    texts = {
        "a": "device = /dev/ttyS1\n",
        "b": "device = /dev/ttyS1\nport = 503\n",
        "d": "device = /dev/ttyS3\nport = 505\n",
    }
    for name, text in texts.items():
        (tmp_path / f"{name}.conf").write_text(text)
    files = [str(tmp_path / f"{name}.conf") for name in "abcd"]
    assert main(["import", "mbusd", *files]) == 1
    printed = capsys.readouterr()
    why = [f"{files[1]}: /dev/ttyS1 is the port of {files[0]} too", f"{files[2]}: there is no such file"]
    assert printed.err.splitlines() == [f"modbus-gateway: error: left out: {each}" for each in why]
    assert all(f"\n# Left out: {each}\n" in printed.out for each in why)
    config = parse(printed.out, port_trouble=lambda _: None).config
    assert [line.port for line in config.line] == ["/dev/ttyS1", "/dev/ttyS3"]


def test_a_device_of_modbus_proxy_that_is_left_out_is_named(tmp_path, capsys):
    file = tmp_path / "p.json"
    device = {"modbus": {"url": "10.0.0.1"}, "listen": {"bind": ":502"}}
    file.write_text(json.dumps({"devices": [device, device]}))
    assert main(["import", "modbus-proxy", str(file)]) == 1
    printed = capsys.readouterr()
    why = f"{file}: device 2: another listener has tcp://0.0.0.0:502 already"
    assert printed.err == f"modbus-gateway: error: left out: {why}\n"
    assert parse(printed.out).config is not None


def test_modbus_proxy_has_one_file(capsys):
    assert main(["import", "modbus-proxy", "a.yml", "b.yml"]) == 2
    assert "modbus-proxy has one file" in capsys.readouterr().err


def test_a_fifo_is_no_file_and_is_not_waited_for(tmp_path, capsys):
    fifo = tmp_path / "mbusd.conf"
    os.mkfifo(fifo)
    assert main(["import", "mbusd", str(fifo)]) == 1
    assert f"{fifo}: is a FIFO, not a file" in capsys.readouterr().err


def test_a_table_of_registers_becomes_a_profile_and_what_is_left_out_is_named(tmp_path, capsys):
    file = tmp_path / "table.csv"
    file.write_text("Name;Address;Type\nVoltage;1;U16\nPower;2;thing\n")
    assert main(["import", "csv", str(file), "--name", "maker-kind"]) == 1
    printed = capsys.readouterr()
    text = printed.out + '[[line]]\nport = "/dev/ttyS0"\n'
    (point,) = parse(text, port_trouble=lambda _: None).config.profile["maker-kind"].points
    assert (point.name, point.holding) == ("voltage", (1, 1))
    notes, errors = printed.err.splitlines()[:-1], printed.err.splitlines()[-1]
    assert errors == f'modbus-gateway: error: left out: {file}: row 3: Power: "thing" is no known type'
    assert all(note.startswith("modbus-gateway: note: ") for note in notes)


def test_what_a_sheet_says_itself_needs_no_note(tmp_path, capsys):
    file = tmp_path / "table.csv"
    file.write_text("Name;Reference;Type\nVoltage;40002;U16\n")
    assert main(["import", "csv", str(file), "--name", "maker-kind"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["csv", "a.csv"], "the profile needs a name"),
        (["csv", "a.csv", "--name", "a b"], '"a b" is no name of a profile'),
        (["csv", "a.csv", "b.csv", "--name", "a"], "csv has one file"),
        (["home-assistant", "a.yaml", "b.yaml"], "home-assistant has one file"),
        (["mbusd", "a.conf", "--name", "a"], "mbusd has no name"),
    ],
)
def test_wrong_arguments_are_said(arguments, said, capsys):
    assert main(["import", *arguments]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"a;b\n1;2\n", b"x" * (1024 * 1024 + 1)])
def test_what_is_no_table_is_said(content, tmp_path, capsys):
    file = tmp_path / "table.csv"
    file.write_bytes(content)
    assert main(["import", "csv", str(file), "--name", "a"]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith(f"modbus-gateway: error: {file}: ")


def test_the_config_of_home_assistant_is_read_with_its_includes_and_secrets(tmp_path, capsys):
    (tmp_path / "secrets.yaml").write_text("host: 10.0.0.1\n")
    (tmp_path / "modbus.yaml").write_text(
        "- {name: h, type: tcp, host: !secret host, port: 502, sensors: [{name: a, address: 1}, {name: b}]}\n"
    )
    file = tmp_path / "configuration.yaml"
    file.write_text("modbus: !include modbus.yaml\nautomation: !include missing.yaml\n")
    assert main(["import", "home-assistant", str(file)]) == 1
    printed = capsys.readouterr()
    assert printed.err == 'modbus-gateway: error: left out: modbus.yaml:1: sensor "b": it has no address\n'
    loaded = parse(printed.out)
    assert loaded.problems == ()
    assert [str(each.to[0]) for each in loaded.config.upstream] == ["tcp://10.0.0.1:502"]


def test_a_config_without_modbus_is_said(tmp_path, capsys):
    file = tmp_path / "configuration.yaml"
    file.write_text("automation: []\n")
    assert main(["import", "home-assistant", str(file)]) == 1
    assert capsys.readouterr().err == f"modbus-gateway: error: {file}: there is no modbus: in it\n"
