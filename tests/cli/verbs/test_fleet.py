"""`fleet hub`: the files that it writes, what stays of earlier ones, and what it says."""

import json
from pathlib import Path

import pytest

from gateway.cli import main
from gateway.fleet.credentials import public_key, read_credentials
from gateway.fleet.hub.known import logins_in

SITES = 'control = "control"\nsites = ["east", "north"]\n'


@pytest.fixture
def file(tmp_path: Path) -> Path:
    made = tmp_path / "fleet.toml"
    made.write_text(SITES)
    assert main.main(["fleet", "hub", str(made)]) == 0
    return made


def run(file: Path, text: str, *words: str) -> int:
    file.write_text(text)
    return main.main(["fleet", "hub", str(file), *words])


def keys(file: Path) -> dict[str, str]:
    """The public keys in the config, by site."""
    return {site: login.key for site, login in logins_in((file.parent / "hub" / "hub.conf").read_text()).items()}


def test_each_site_has_a_file_with_its_key_that_only_its_owner_reads(file: Path) -> None:
    folder = file.parent / "hub"
    assert folder.stat().st_mode & 0o777 == 0o700
    assert {each.name for each in folder.iterdir()} == {"hub.conf", "control.creds", "east.creds", "north.creds"}
    assert {each.stat().st_mode & 0o777 for each in folder.iterdir()} == {0o600}
    made = {site: public_key(read_credentials((folder / f"{site}.creds").read_text()).key) for site in keys(file)}
    assert made == keys(file)
    assert len(set(made.values())) == 3


def test_run_again_it_keeps_what_is_there_and_adds_what_is_new(file: Path) -> None:
    before, east = keys(file), (file.parent / "hub" / "east.creds").read_text()
    (file.parent / "hub" / "north.creds").unlink()  # it is at its site
    assert run(file, SITES.replace('"north"', '"north", "west"')) == 0
    assert keys(file) == before | {"west": keys(file)["west"]}
    assert (file.parent / "hub" / "east.creds").read_text() == east
    assert not (file.parent / "hub" / "north.creds").exists()


def test_a_config_that_is_lost_gets_the_keys_of_the_files(file: Path) -> None:
    before = keys(file)
    (file.parent / "hub" / "hub.conf").unlink()
    assert run(file, SITES) == 0
    assert keys(file) == before


def test_a_site_that_is_taken_out_loses_its_account_and_that_is_said(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert run(file, SITES.replace(', "north"', "")) == 0
    said = capsys.readouterr().out
    assert "Removed: north." in said
    assert "can be deleted: north.creds." in said
    assert keys(file).keys() == {"control", "east"}
    assert (file.parent / "hub" / "north.creds").exists()


def test_a_new_key_replaces_only_that_of_its_site(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = keys(file)
    assert run(file, SITES, "--renew", "east") == 1
    assert "east.creds exists" in capsys.readouterr().err
    assert keys(file) == before
    (file.parent / "hub" / "east.creds").unlink()
    assert run(file, SITES, "--renew", "east") == 0
    assert {site for site, key in keys(file).items() if key != before[site]} == {"east"}
    assert run(file, SITES, "--renew", "eats") == 2


def test_a_file_of_another_key_is_not_taken_for_that_of_a_site(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = file.parent / "hub"
    before = (folder / "hub.conf").read_text()
    (folder / "east.creds").write_text((folder / "north.creds").read_text())
    assert run(file, SITES) == 1
    assert "east.creds has another key than hub.conf" in capsys.readouterr().err
    (folder / "east.creds").write_text("nothing")
    assert run(file, SITES) == 1
    assert "east.creds: it is not a credentials file" in capsys.readouterr().err
    assert (folder / "hub.conf").read_text() == before


def test_renew_takes_a_file_whose_key_the_config_does_not_have(file: Path) -> None:
    """As when the power failed between both."""
    folder, before = file.parent / "hub", keys(file)
    old = (folder / "hub.conf").read_text()
    (folder / "east.creds").unlink()
    assert run(file, SITES, "--renew", "east") == 0
    (folder / "hub.conf").write_text(old)
    assert run(file, SITES) == 1
    assert run(file, SITES, "--renew", "east") == 0
    made = public_key(read_credentials((folder / "east.creds").read_text()).key)
    assert keys(file) == before | {"east": made}


def test_a_config_of_somebody_else_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "hub").mkdir()
    (tmp_path / "hub" / "hub.conf").write_text("port: 4222\n")
    assert run(tmp_path / "fleet.toml", SITES) == 1
    assert "was not written by this command" in capsys.readouterr().err
    assert [each.name for each in (tmp_path / "hub").iterdir()] == ["hub.conf"]


def test_a_leaf_node_keeps_its_password_and_has_a_config(tmp_path: Path) -> None:
    text = f'{SITES}leaf_nodes = ["east"]\naddress = "hub.example"\n'
    file, folder = tmp_path / "fleet.toml", tmp_path / "hub"
    assert run(file, text) == 0
    first = (folder / "east.leaf.conf").read_text()
    (folder / "east.creds").unlink()
    assert run(file, text) == 0
    assert (folder / "east.leaf.conf").read_text() == first
    password = logins_in((folder / "hub.conf").read_text())["east"].password
    assert len(password) > 40
    assert f"nats-leaf://east:{password}@hub.example:7422" in first


def test_a_folder_in_which_others_can_put_keys_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "hub"
    folder.mkdir()
    folder.chmod(0o777)
    assert run(tmp_path / "fleet.toml", SITES) != 0
    assert "others can change files" in capsys.readouterr().err
    assert not [*folder.iterdir()]


def test_it_says_what_to_do_next(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    more = 'address = "hub.example"\ncertificate = "/c"\nkey = "/k"\nca = "/etc/ca.crt"\n'
    assert run(file, SITES.replace('"north"', '"north", "west"') + more) == 0
    said = capsys.readouterr().out
    for line in (
        "New: west.creds.",
        "sudo nats-server -t -c /etc/nats-server.conf",
        'servers     = ["tls://hub.example:4222"]',
        'credentials = "/etc/modbus-gateway/fleet.creds"',
        'ca          = "/etc/ca.crt"',
    ):
        assert line in said
    assert "LoadCredential" not in said


def test_a_key_that_may_ask_all_sites_is_not_for_the_group(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path / "fleet.toml", SITES) == 0
    said = capsys.readouterr().out
    assert "At control, where the key may ask all sites, this instead:\n  sudo install -D -m 600" in said
    assert "LoadCredential=fleet:/etc/modbus-gateway/fleet.creds" in said


def test_json_names_what_was_made(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert run(file, SITES.replace('"north"', '"west"'), "--json") == 0
    assert json.loads(capsys.readouterr().out) == {
        "config": str(file.parent / "hub" / "hub.conf"),
        "sites": ["control", "east", "west"],
        "new": ["west"],
        "away": [],
        "removed": ["north"],
        "useless": ["north.creds"],
    }


def test_a_file_with_a_problem_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path / "fleet.toml", 'control = "control"\nsites = ["a b"]') == 1
    assert f"{tmp_path}/fleet.toml:2:10: error: sites[0]" in capsys.readouterr().err
    assert not (tmp_path / "hub").exists()
    assert main.main(["fleet", "hub", str(tmp_path / "none.toml")]) == 1
