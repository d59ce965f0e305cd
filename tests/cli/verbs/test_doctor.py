"""`doctor`: what it prints of the daemon's findings and of what it sees itself, and its exit status."""

import json

import pytest

from gateway.cli.main import FINE, PROBLEM_FOUND, main
from gateway.cli.verbs import doctor
from gateway.errors import DaemonError
from kit.control import FakeConversation

FIX = {"level": "fix", "about": "hall", "what": "nobody answers", "remedy": "gateway.toml:3: baud = 9600", "unit": ""}
OK = {"level": "ok", "about": "hall", "what": "2 units answer", "remedy": "", "unit": ""}


class Daemon(FakeConversation):
    """A daemon whose findings and ports the test sets."""

    def __init__(self):
        super().__init__(lambda question: [{"findings": self.findings, "ports": self.ports}])
        self.findings = [OK]
        self.ports = []

    def wait_for(self, seconds):
        assert seconds > 60


@pytest.fixture
def daemon(monkeypatch):
    daemon = Daemon()
    monkeypatch.setattr(doctor, "Conversation", daemon)
    return daemon


def test_a_row_for_each_finding_and_behind_it_what_mends_it(daemon, capsys):
    daemon.findings = [OK, FIX]
    assert main(["doctor"]) == PROBLEM_FOUND
    assert capsys.readouterr().out.splitlines() == [
        "ok    hall: 2 units answer",
        "fix   hall: nobody answers",
        "      -> gateway.toml:3: baud = 9600",
    ]


def test_without_anything_to_fix_the_status_is_0(daemon):
    daemon.findings = [OK, {**OK, "level": "note"}]
    assert main(["doctor"]) == FINE


def test_the_words_of_the_command_reach_the_daemon(daemon):
    main(["doctor", "hall", "--passive"])
    main(["doctor"])
    assert daemon.questions == [
        {"verb": "doctor", "line": "hall", "ask": False},
        {"verb": "doctor", "ask": True},
    ]


def test_json_has_every_finding(daemon, capsys):
    daemon.findings = [FIX]
    assert main(["doctor", "--json"]) == PROBLEM_FOUND
    assert json.loads(capsys.readouterr().out) == {"findings": [FIX]}


def test_ports_are_looked_at_from_outside(daemon, capsys):
    daemon.ports = [{"line": "hall", "source": "gateway.toml:3", "port": "/dev/nothing", "is_open": False}]
    assert main(["doctor"]) == PROBLEM_FOUND
    assert "fix   port of hall: /dev/nothing does not exist" in capsys.readouterr().out


def test_a_line_that_is_down_for_its_port_is_one_fault(daemon, capsys):
    down = {"level": "fix", "what": "is down: /dev/nothing does not exist", "remedy": "correct what is named here"}
    daemon.findings = [{**down, "about": "hall"}, {**down, "about": "motion"}]
    daemon.ports = [{"line": "hall", "source": "gateway.toml:3", "port": "/dev/nothing", "is_open": False}]
    assert main(["doctor"]) == PROBLEM_FOUND
    rows = [row for row in capsys.readouterr().out.splitlines() if row.startswith("fix")]
    assert [row.partition(": ")[0] for row in rows] == ["fix   port of hall", "fix   motion"]


def test_a_finding_of_another_version_is_shown_if_it_has_what_a_finding_needs(daemon, capsys):
    daemon.findings = [{"level": "note", "about": "hall", "what": "something", "new": 1}]
    assert main(["doctor"]) == FINE
    assert capsys.readouterr().out == "note  hall: something\n"
    daemon.findings = [OK, {"level": "new", "about": "hall", "what": "something"}]
    assert main(["doctor"]) == PROBLEM_FOUND
    assert "'findings[1].level' is none of ok, note, fix" in capsys.readouterr().err


def config(tmp_path, text):
    file = tmp_path / "gateway.toml"
    file.write_text(text)
    return str(file)


def test_without_a_daemon_the_config_and_its_ports_are_looked_at(tmp_path, capsys):
    file = config(tmp_path, '[[line]]\nname = "hall"\nport = "/dev/nothing"\n')
    assert main(["doctor", "--config", file]) == PROBLEM_FOUND
    said = capsys.readouterr().out
    assert "fix   port of hall: /dev/nothing does not exist" in said


def test_a_wrong_config_is_shown_with_its_remedy(tmp_path, capsys):
    file = config(tmp_path, '[[line]]\nport = "/dev/nothing"\nbaudrate = 9600\n')
    assert main(["doctor", "--config", file]) == PROBLEM_FOUND
    said = capsys.readouterr().out
    assert "baudrate" in said
    assert '-> did you mean "baud"?' in said


def test_a_problem_of_the_config_names_the_file_once(tmp_path, capsys):
    file = config(tmp_path, '[[line]]\nport = "/dev/nothing"\nbaudrate = 9600\n')
    main(["doctor", "--config", file, "--json"])
    (wrong,) = (each for each in json.loads(capsys.readouterr().out)["findings"] if each["about"] == file)
    assert wrong["what"].startswith("3:1: error: line[0].baudrate: unknown key")


def test_the_gateway_with_this_config_is_asked_if_it_runs(daemon, tmp_path):
    file = config(tmp_path, '[[line]]\nname = "hall"\nport = "/dev/nothing"\n[control]\nsocket = "gw.sock"\n')
    assert main(["doctor", "--config", file]) == FINE
    assert daemon.meant.socket == tmp_path / "gw.sock"
    assert daemon.questions == [{"verb": "doctor", "ask": True}]


def test_for_a_gateway_that_is_named_no_config_of_another_one_is_looked_at(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(doctor, "DEFAULT_CONFIG", config(tmp_path, '[[line]]\nname = "hall"\nport = "/dev/nothing"\n'))
    monkeypatch.setenv("MODBUS_GATEWAY_CONTROL", str(tmp_path / "none.sock"))
    assert main(["doctor"]) == PROBLEM_FOUND
    said = capsys.readouterr()
    assert (said.out, "no running gateway found" in said.err) == ("", True)


def test_a_line_that_the_config_does_not_have(tmp_path, capsys):
    file = config(tmp_path, '[[line]]\nname = "hall"\nport = "/dev/nothing"\n')
    assert main(["doctor", "hal", "--config", file]) == PROBLEM_FOUND
    assert 'there is no line "hal"; did you mean "hall"?' in capsys.readouterr().err


def test_when_no_gateway_runs_that_is_a_note(monkeypatch, tmp_path, capsys):
    def nobody(control):
        raise DaemonError("no running gateway found")

    monkeypatch.setattr(doctor, "Conversation", nobody)
    monkeypatch.setattr(doctor, "DEFAULT_CONFIG", config(tmp_path, '[[line]]\nname = "hall"\nport = "/dev/nothing"\n'))
    assert main(["doctor"]) == PROBLEM_FOUND
    said = capsys.readouterr().out
    assert said.startswith("note  gateway: no running gateway found")
    assert "-> systemctl start modbus-gateway" in said
    assert "fix   port of hall" in said
    assert main(["doctor", "--control", "/nowhere"]) == PROBLEM_FOUND
    assert "no running gateway found" in capsys.readouterr().err


def test_in_a_checkout_without_a_gateway_there_is_nothing_to_look_at(monkeypatch, tmp_path, capsys):
    def nobody(control):
        raise DaemonError("no running gateway found")

    monkeypatch.setattr(doctor, "Conversation", nobody)
    monkeypatch.setattr(doctor, "DEFAULT_CONFIG", str(tmp_path / "gateway.toml"))
    assert main(["doctor"]) == PROBLEM_FOUND
    assert capsys.readouterr().out.splitlines() == [
        "fix   gateway: no running gateway found",
        "      -> start it: modbus-gateway run FILE; or look at its config: modbus-gateway doctor --config FILE",
    ]
