"""`support`: one file with what helps to help, and without a secret."""

import os

import pytest

from gateway.cli.main import main
from gateway.cli.verbs import support
from kit.bundles import documents_in
from kit.control import FakeConversation

#: Most of it is refused by `check`; it is in the file all the same.
SECRETS = """
# password = "comment-geheim"
[[image]]
unit = 200
name = "shift"
holding = 2

[web]
bind = "http://127.0.0.1:8502"
token = "token-geheim"

[mqtt]
broker = "mqtt://gw:url-geheim@broker.plant"
password = '''
multi-geheim
line'''
pasword = "slip-geheim"
publish = [{ device = "shift", points = ["*"], every = "1 s" }]
"""
PROFILE = """
[profile.meter]
# apikey-geheim
points = [{ name = "a", holding = 0 }]
"""
JOURNAL = "#!/bin/sh\necho 'mqtt_down tried url-geheim, slip-geheim and token-geheim'\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A machine with a config, a profile, a journal and a state directory; no gateway runs."""
    (tmp_path / "gateway.toml").write_text(SECRETS)
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "meter.toml").write_text(PROFILE)
    (tmp_path / "state").mkdir()
    (tmp_path / "state" / "addresses.json").write_text("{}")
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "journalctl").write_text(JOURNAL)
    (tmp_path / "bin" / "journalctl").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("MODBUS_GATEWAY_CONTROL", str(tmp_path / "no.sock"))
    return tmp_path


def made(place, *words):
    file = place / "bundle.tar.gz"
    assert main(["support", str(file), "--config", str(place / "gateway.toml"), *words]) == 0
    return documents_in(file.read_bytes())


def test_no_secret_of_the_config_is_in_any_document(place):
    documents = made(place)
    assert {"config/gateway.toml", "config/profiles/meter.toml", "check.txt", "log.txt"} <= set(documents)
    for name, text in documents.items():
        assert "geheim" not in text, name
    assert "mqtt_down tried" in documents["log.txt"]
    assert "mqtt.password" in documents["check.txt"]


def test_a_config_that_is_no_toml_is_left_out_and_its_secrets_are_hidden_elsewhere(place):
    (place / "gateway.toml").write_text('[mqtt\npassword = "url-geheim"\ntoken = slip-geheim token-geheim\n')
    (place / "bin" / "journalctl").write_text("#!/bin/sh\necho 'tried url-geheim'\n")
    documents = made(place)
    assert "config/gateway.toml" not in documents
    assert "config/gateway.toml: missing: it is no TOML" in documents["README.txt"]
    assert all("url-geheim" not in text for text in documents.values())


def test_what_can_be_seen_without_a_gateway_is_there_and_what_is_missing_is_said(place, capsys):
    documents = made(place)
    assert "addresses.json" in documents["state.txt"]
    assert "pydantic " in documents["versions.txt"]
    assert "trace.jsonl" not in documents
    assert "without the running gateway: no running gateway found" in capsys.readouterr().out


def test_only_who_made_it_may_read_it(place):
    made(place)
    assert (place / "bundle.tar.gz").stat().st_mode & 0o777 == 0o600


def test_a_file_that_exists_is_replaced_only_if_that_is_said(place, capsys):
    file = place / "bundle.tar.gz"
    file.write_text("mine")
    assert main(["support", str(file), "--config", str(place / "gateway.toml")]) == 1
    assert "exists; name another file, or replace it with --force" in capsys.readouterr().err
    assert file.read_text() == "mine"
    assert made(place, "--force")


def test_a_link_that_leads_nowhere_is_not_followed(place, capsys):
    (place / "bundle.tar.gz").symlink_to(place / "elsewhere")
    assert main(["support", str(place / "bundle.tar.gz"), "--config", str(place / "gateway.toml")]) == 1
    assert "exists" in capsys.readouterr().err
    made(place, "--force")
    assert not (place / "elsewhere").exists()


def test_a_place_that_cannot_be_written_is_an_error_in_words(place, capsys):
    missing = place / "nowhere" / "bundle.tar.gz"
    assert main(["support", str(missing), "--config", str(place / "gateway.toml")]) == 1
    assert f"{missing} cannot be written: No such file or directory" in capsys.readouterr().err


def test_what_the_gateway_tells_is_asked_for_and_hidden_too(place, monkeypatch, capsys):
    daemon = FakeConversation(
        lambda question: (
            [{"config": str(place / "gateway.toml")}]
            if question["verb"] == "which"
            else [{"name": "status.json", "text": "url-"}, {"name": "status.json", "text": "geheim {}"}]
        )
    )
    monkeypatch.setattr(support, "Conversation", daemon)
    documents = made(place, "--no-trace")
    assert daemon.questions[-1] == {"verb": "support", "trace": False}
    assert documents["status.json"] == "••• {}"
    assert "the running gateway" not in capsys.readouterr().out
