"""What `check` says of the files with users and passwords, and of libraries."""

import grp
import json
import os
import socket
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import pytest

from gateway.config.load import load
from gateway.readconfig.file_troubles import with_file_troubles
from gateway.readconfig.libraries import not_installed
from kit.browser import CHEAP_HASH

CONFIG = """\
[[line]]
name = "hall"
port = "/dev/null"
baud = 9600

[web]
bind = "http://127.0.0.1:8502"
users = "{users}"
write = {write}
"""

MQTT = """\
site = "plant-2"

[[line]]
name = "hall"
port = "/dev/null"
baud = 9600
devices = [{{ unit = 1, name = "silo-1", points = [{{ name = "weight", holding = 0 }}] }}]

[mqtt]
broker = "mqtt://127.0.0.1:1883"
publish = [{{ device = "silo-1", every = "1 s" }}]

user = "plant-2"
password = {{ {password} }}
"""


@pytest.fixture
def troubles(tmp_path):
    """Writes the config and, unless None, the users; what is said of these."""
    users, file = tmp_path / "users", tmp_path / "gateway.toml"

    def find(text, *, mode=0o600, write="false", folder=tmp_path / "elsewhere"):
        if text is not None:
            users.write_text(text)
            users.chmod(mode)
        file.write_text(CONFIG.format(users=users, write=write))
        loaded = with_file_troubles(load(file), str(file), folder)
        assert loaded.config is not None
        return [str(each) for each in loaded.problems if str(each.path[:1]) == "('web',)"]

    return find


def test_a_file_that_can_be_used_is_fine(troubles):
    assert troubles(f"anna:operator:{CHEAP_HASH}\n", write="true") == []


@pytest.mark.parametrize(
    ("text", "settings", "what", "remedy"),
    [
        (None, {}, "there will be no web page", "modbus-gateway user add"),
        (f"anna:operator:{CHEAP_HASH}", {"mode": 0o644}, "others may read or change", "chmod o=,g-w"),
        (f"anna:operator:{CHEAP_HASH}", {"mode": 0o660}, "others may read or change", "chmod o=,g-w"),
        ("anna:operator:geheim", {}, "users:1: this is no user", ""),
        ("", {}, "has no users", "modbus-gateway user add"),
        (f"vera:viewer:{CHEAP_HASH}", {"write": "true"}, "has no operator", "--role operator"),
    ],
)
def test_what_keeps_it_from_being_used_is_a_warning_at_its_place(troubles, text, settings, what, remedy):
    (told,) = troubles(text, **settings)
    assert "gateway.toml:8:9: warning: web.users: " in told
    assert what in told
    assert remedy in told
    assert "geheim" not in told


def test_without_an_operator_nobody_needs_one_who_only_reads(troubles):
    assert troubles(f"vera:viewer:{CHEAP_HASH}") == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root has files that only root may read")
@pytest.mark.parametrize(("mode", "group", "is_fine"), [(0o600, 0, False), (0o640, 0, False), (0o640, 20, True)])
def test_the_service_has_to_be_able_to_read_it(troubles, tmp_path, mode, group, is_fine):
    users = tmp_path / "users"
    users.touch()
    os.chown(users, 0, group)
    told = troubles(f"anna:operator:{CHEAP_HASH}", mode=mode, folder=tmp_path)
    assert (told == []) is is_fine
    assert is_fine or "chgrp dialout" in told[0]


def test_who_may_not_read_it_is_told(tmp_path):
    users, file = tmp_path / "users", tmp_path / "gateway.toml"
    users.touch(mode=0o200)
    file.write_text(CONFIG.format(users=users, write="false"))
    loaded = load(file)
    with not_as_root():
        (told,) = with_file_troubles(loaded, str(file), tmp_path / "elsewhere").problems
    assert "cannot be read by the user who runs this command" in str(told)


@pytest.fixture
def about_mqtt(tmp_path):
    """Writes a config with this password; what is said of [mqtt]."""

    def find(password, who=nullcontext()):  # noqa: B008 - it can be used again
        file = tmp_path / "gateway.toml"
        file.write_text(MQTT.format(password=password))
        loaded = load(file)
        with who:
            loaded = with_file_troubles(loaded, str(file), tmp_path / "elsewhere")
        assert loaded.config is not None
        return [str(each) for each in loaded.problems if str(each.path[:1]) == "('mqtt',)"]

    return find


def test_a_password_that_can_be_used_is_fine(about_mqtt, tmp_path):
    (tmp_path / "password").touch(mode=0o600)
    assert about_mqtt(f'file = "{tmp_path}/password"') == []


def test_a_credential_is_known_to_the_service_only(about_mqtt):
    assert about_mqtt('credential = "mqtt"') == []


@pytest.mark.parametrize(
    ("mode", "what"), [(None, "No such file or directory"), (0o644, "others may read or change it; chmod o=,g-w ")]
)
def test_a_password_that_cannot_be_used_is_a_warning_at_its_place(about_mqtt, tmp_path, mode, what):
    if mode is not None:
        (tmp_path / "password").touch(mode=mode)
    (told,) = about_mqtt(f'file = "{tmp_path}/password"')
    assert f":14:12: warning: mqtt.password: nothing will be published: {tmp_path}/password: {what}" in told


def test_who_may_not_read_the_password_is_told(about_mqtt, tmp_path):
    (tmp_path / "password").touch(mode=0o200)
    told = about_mqtt(f'file = "{tmp_path}/password"', not_as_root())[-1]  # behind what root's home keeps from others
    assert "cannot be read by the user who runs this command" in told


@pytest.mark.parametrize(
    ("module", "said"),
    [
        ("paho", [f"12:1: warning: mqtt: has no effect: {not_installed('paho', 'mqtt')}"]),
        ("jinja2", [f"9:1: warning: web: has no effect: {not_installed('jinja2', 'web')}"]),
    ],
)
def test_a_library_that_is_missing_is_a_warning(tmp_path, monkeypatch, module, said):
    monkeypatch.setattr("gateway.readconfig.libraries.find_spec", lambda name: None if name == module else name)
    file = tmp_path / "gateway.toml"
    text = MQTT.format(password='credential = "mqtt"').replace("[mqtt]", '[web]\nbind = "http://127.0.0.1:1"\n\n[mqtt]')
    file.write_text(text)
    told = map(str, with_file_troubles(load(file), str(file), tmp_path / "elsewhere").problems)
    assert [each.partition("gateway.toml:")[2] for each in told if "has no effect" in each] == said


@contextmanager
def not_as_root():
    """Root may read everything."""
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(user)


@pytest.mark.parametrize("url", ["", "file:///tmp/mbgw-0.1.0-py3-none-any.whl"])
@pytest.mark.parametrize(
    ("environment", "command"),
    [
        ("/home/anna/.local/share/pipx/venvs/mbgw", "pipx install --force"),
        ("/home/anna/.local/share/uv/tools/mbgw", "uv tool install --force"),
        ("/srv/plant/venv", "/srv/plant/venv/bin/pip install"),
    ],
)
def test_a_missing_library_is_told_with_the_command_that_installs_it(environment, command, url, monkeypatch):
    monkeypatch.setattr("sys.prefix", environment)
    installed = SimpleNamespace(read_text=lambda _: json.dumps({"url": url}) if url else None)
    monkeypatch.setattr("importlib.metadata.distribution", lambda _: installed)
    assert not_installed("aiohttp", "web") == (
        "aiohttp is not installed: mbgw was installed without [web]; "
        f'{command} "mbgw[web,mqtt,fleet,yaml]{url and f" @ {url}"}"'
    )


@pytest.mark.parametrize(
    ("environment", "command"),
    [("/usr", "sudo apt install --reinstall modbus-gateway"), ("/src/.venv", "uv sync --all-extras")],
)
def test_what_no_installer_of_python_knows_is_made_whole(environment, command, monkeypatch):
    monkeypatch.setattr("sys.prefix", environment)
    assert not_installed("aiohttp", "web") == f"aiohttp is not installed; {command}"


@pytest.mark.parametrize(("mode", "is_refused"), [(0o600, False), (0o640, False), (0o644, True), (0o660, True)])
def test_a_token_that_others_may_read_is_told(tmp_path, mode, is_refused):
    token, file = tmp_path / "token", tmp_path / "gateway.toml"
    token.write_text("s3cret")
    token.chmod(mode)
    text = CONFIG.partition("users")[0] + f'token = {{ file = "{token}" }}\n'
    file.write_text(text)
    loaded = with_file_troubles(load(file), str(file), tmp_path / "elsewhere")
    said = [str(each) for each in loaded.problems if str(token) in str(each)]
    told = f"{file}:8:9: warning: web.token: there will be no web page: {token}: "
    assert said == ([f"{told}others may read or change it; chmod o=,g-w {token}"] if is_refused else [])


FLEET = """\
site = "plant-2"

[[image]]
unit = 1
holding = 10

[fleet]
servers = ["nats://127.0.0.1:4222"]
{login}
"""
JWT = "-----BEGIN NATS USER JWT-----\neyJ\n"
SEED = f"-----BEGIN USER NKEY SEED-----\n{'SU' + 'A' * 56}\n"


@pytest.fixture
def about(tmp_path):
    """Writes a config; what is said of files beside it."""

    def find(text, who=nullcontext()):  # noqa: B008 - it can be used again
        file = tmp_path / "gateway.toml"
        file.write_text(text)
        loaded = load(file)
        with who:
            problems = with_file_troubles(loaded, str(file), tmp_path / "elsewhere").problems
        return [str(each).removeprefix(f"{file}:") for each in problems if len(each.path) == 2]

    return find


@pytest.mark.parametrize(
    ("login", "content", "mode", "reason"),
    [
        ('user = "p"\npassword = {{ file = "{}" }}', "geheim", 0o600, ""),
        ('user = "p"\npassword = {{ file = "{}" }}', None, 0, "No such file or directory"),
        ('user = "p"\npassword = {{ file = "{}" }}', "geheim", 0o644, "others may read or change it; chmod o=,g-w {}"),
        ('credentials = "{}"', JWT + SEED, 0o600, ""),
        ('credentials = "{}"', None, 0, "No such file or directory"),
        ('credentials = "{}"', JWT + SEED, 0o644, "others may read or change it; chmod o=,g-w {}"),
        ('credentials = "{}"', JWT, 0o600, "it is not a credentials file: that has the seed of a user"),
    ],
)
def test_what_the_gateway_logs_in_to_a_fleet_with_is_read(about, tmp_path, monkeypatch, login, content, mode, reason):
    monkeypatch.setattr("gateway.readconfig.file_troubles.find_spec", lambda name: name)
    secret = tmp_path / "secret"
    if content is not None:
        secret.write_text(content)
        secret.chmod(mode)
    place, key = ("9:15", "credentials") if login.startswith("credentials") else ("10:12", "password")
    told = f"{place}: warning: fleet.{key}: other sites cannot be reached: {secret}: {reason.format(secret)}"
    assert about(FLEET.format(login=login.format(secret))) == ([told] if reason else [])


def test_who_may_not_read_credentials_is_told(about, tmp_path):
    secret = tmp_path / "secret"
    secret.touch(mode=0o200)
    (told,) = about(FLEET.format(login=f'credentials = "{secret}"'), not_as_root())
    assert told.startswith(
        f"9:15: warning: fleet.credentials: {secret} cannot be read by the user who runs this command"
    )


def test_credentials_need_a_library(about, tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.readconfig.file_troubles.find_spec", lambda name: None if name == "nacl" else name)
    secret = tmp_path / "secret"
    secret.touch(mode=0o600)
    secret.write_text(JWT + SEED)
    (told,) = about(FLEET.format(login=f'credentials = "{secret}"'))
    assert "fleet.credentials: other sites cannot be reached: a credentials file needs PyNaCl" in told


def test_the_service_itself_looks_at_its_credentials(about, tmp_path, monkeypatch):
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    (told,) = about(FLEET.format(login='user = "p"\npassword = { credential = "fleet" }'))
    assert f"fleet.password: other sites cannot be reached: {tmp_path}/fleet: No such file or directory" in told


@pytest.mark.parametrize(("content", "reason"), [(None, "No such file or directory"), ("\n", "the file is empty")])
def test_a_token_that_cannot_be_used_is_told(about, tmp_path, content, reason):
    token = tmp_path / "token"
    if content is not None:
        token.touch(mode=0o600)
        token.write_text(content)
    text = CONFIG.partition("users")[0] + f'token = {{ file = "{token}" }}\n'
    assert about(text) == [f"8:9: warning: web.token: there will be no web page: {token}: {reason}"]


def test_a_pipe_is_no_file_with_a_password(about, tmp_path):
    os.mkfifo(tmp_path / "password", 0o600)
    (told,) = about(MQTT.format(password=f'file = "{tmp_path}/password"'))
    assert told.endswith(f"nothing will be published: {tmp_path}/password: is not a regular file")


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("absent/control.sock", ""),
        ("absent/twice/control.sock", ""),
        ("socket", ""),
        ("file/control.sock", "{}/file is not a folder"),
        ("file", "a file with this name exists and is not a socket"),
    ],
)
def test_a_control_socket_that_cannot_be_made_is_told(about, tmp_path, path, reason):
    (tmp_path / "file").touch()
    with socket.socket(socket.AF_UNIX) as other:
        other.bind(str(tmp_path / "socket"))
        said = about(f'[[image]]\nunit = 1\nholding = 10\n[control]\nsocket = "{tmp_path}/{path}"\n')
    told = f"5:10: warning: control.socket: no command will reach the gateway: {tmp_path}/{path}: "
    assert said == ([told + reason.format(tmp_path)] if reason else [])


def test_who_may_not_make_the_control_socket_is_told(about):
    text = '[[image]]\nunit = 1\nholding = 10\n[control]\nsocket = "/no-such-folder/control.sock"\n'
    (told,) = about(text, not_as_root())
    assert told.endswith(": /no-such-folder/control.sock: the user who runs this command cannot create files in /")


@pytest.fixture
def with_profiles(tmp_path):
    """What is said of a config of the service beside which these profiles are, without its own file."""

    def find(**texts):
        (tmp_path / "profiles").mkdir()
        for name, text in texts.items():
            (tmp_path / "profiles" / f"{name}.toml").write_text(text)
            (tmp_path / "profiles" / f"{name}.toml").chmod(0o644)
        file = tmp_path / "gateway.toml"
        file.write_text('[[line]]\nport = "/dev/null"\nprofile = "used"\ndevices = [{ unit = 1 }]\n')
        (tmp_path / "profiles" / "used.toml").chmod(0o640)
        found = with_file_troubles(load(file), str(file), tmp_path)
        assert found.config is not None
        return [str(each) for each in found.problems if each.file != str(file)]

    return find


def test_a_profile_in_use_that_the_service_cannot_read(with_profiles, tmp_path):
    file = f"{tmp_path}/profiles/used.toml"
    (said,) = with_profiles(used="[profile.used]\n")
    assert said == f"{file}: warning: the service may not be able to read this file\n  help: sudo chmod 644 {file}"


def test_a_broken_profile_that_is_not_in_use_is_a_warning(with_profiles, tmp_path):
    bad, renamed, _used = with_profiles(
        used="[profile.used]\n", good="[profile.good]\n", bad="[profile.bad]\nmargin = 0\n", renamed="[profile.x]\n"
    )
    what = "warning: profile.bad.margin: must be at least 1 (no device has this profile)"
    assert bad == f"{tmp_path}/profiles/bad.toml:2:10: {what}"
    assert renamed.startswith(f"{tmp_path}/profiles/renamed.toml:1:1: warning: profile.x: the file is renamed.toml")


@pytest.fixture
def about_virtual_port(tmp_path):
    """What is said of a line with this virtual port and these keys."""

    def find(port, keys=""):
        file = tmp_path / "gateway.toml"
        file.write_text(f'[[image]]\nunit = 1\nholding = 1\n[[line]]\nport = "pty:{port}"\nrole = "server"\n')
        file.write_text(file.read_text() + f'serves = "all"\n{keys}')
        return [(each.path[2], each.what) for each in with_file_troubles(load(file), str(file)).problems]

    return find


def test_a_virtual_port_that_can_be_made(about_virtual_port, tmp_path):
    group = grp.getgrgid(os.getegid()).gr_name
    assert about_virtual_port("ttyHMI", f'group = "{group}"') == []
    assert about_virtual_port(tmp_path / "com1", f'group = "{group}"') == []


def test_the_group_of_a_virtual_port(about_virtual_port):
    what = 'there is no group "no-such-group" on this machine'
    assert about_virtual_port("ttyHMI", 'group = "no-such-group"') == [("group", what)]


def test_what_is_at_the_place_of_the_link_of_a_virtual_port(about_virtual_port, tmp_path):
    own = f'group = "{grp.getgrgid(os.getegid()).gr_name}"\n'
    (tmp_path / "com1").touch()
    (tmp_path / "com2").symlink_to("/dev/pts/4711")
    found = [("port", f"{tmp_path}/com1 is there already and is not a virtual port")]
    assert about_virtual_port(tmp_path / "com1", own) == found
    assert about_virtual_port("com1", f'{own}[control]\nsocket = "{tmp_path}/control.sock"\n') == found
    assert about_virtual_port(tmp_path / "com2", own) == []


def test_the_folder_of_a_virtual_port(about_virtual_port, tmp_path):
    group = grp.getgrgid(os.getegid()).gr_name
    found = about_virtual_port(tmp_path / "nowhere/com1", f'group = "{group}"')
    assert found == [("port", f"there is no folder {tmp_path}/nowhere")]


def test_included_files_are_looked_at_too(tmp_path):
    folder = tmp_path / "conf.d"
    folder.mkdir()
    (folder / "b.toml").write_text('# web\n[web]\nbind = "http://127.0.0.1:0"\nusers = "users"\n')
    (folder / "b.toml").chmod(0o600)
    file = tmp_path / "gateway.toml"
    file.write_text('include = ["conf.d/*.toml"]\n[[image]]\nunit = 200\nholding = 1\n')
    unreadable, no_users = with_file_troubles(load(file), str(file), tmp_path).problems
    assert str(unreadable).startswith(f"{folder}/b.toml: warning: the service may not be able to read this file")
    assert str(no_users).startswith(f"{folder}/b.toml:4:9: warning: web.users: ")
    assert f"{folder}/users" in str(no_users)
