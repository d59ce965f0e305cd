"""A config as it may be shown."""

import time
from contextlib import suppress

import pytest

from gateway.config.load import parse
from gateway.config.reading.masking import is_secret, masked
from gateway.config.schema.table import Table, keys_of


@pytest.mark.parametrize(
    "text",
    [
        'password = "geheim"',
        'Password="geheim"',
        "mqtt_password = 'geheim'",
        'pw = "geheim"',
        'mqtt.auth = "geheim"',
        '"密码" = "geheim"',
        'contrasena = "geheim"',
        '"password" = "geheim"',
        '"pass\\u0077ord" = "geheim"',
        'password = """geheim\nand more"""',
        "password = '''\ngeheim'''",
        'password = "with \\" geheim"',
        'password."text" = "geheim"',
        'broker = { user = "anna", password = "geheim", port = 1883 }',
        'token = "geheim"',
        'client_secret = "geheim"',
        'passwort = "geheim"',
        'pasword = "geheim"',
        'pwd = "geheim"',
        'tokn = "geheim"',
        'secert = "geheim"',
        'token = { text = "geheim" }',
        'token = { file = "t", text = "geheim" }',
        'tokens = ["geheim", "]geheim", # ]\n"geheim"]',
        'password.text = "geheim"',
        'web.token = "geheim"',
        'password = "geheim •••"',
        '[mqtt.password]\ntext = "geheim"',
        '[mqtt.passwort]\nx = ["geheim"]',
        'to = "mqtt://anna:geheim@10.2.0.1"',
        'to = "mqtt://anna:x/geheim@10.2.0.1"',
        'to = "mqtt://anna:x@geheim@10.2.0.1"',
        'to = "mqtt://anna:x geheim@10.2.0.1"',
        'to = "nats://geheim@10.2.0.1"',
        'to = "mqtt:\\u002f/anna:geheim@10.2.0.1"',
        "key = '''\n-----BEGIN PRIVATE KEY-----\ngeheim\n-----END PRIVATE KEY-----\n'''",
    ],
)
def test_a_secret_is_not_shown(text):
    shown = masked(f"a = 1\n{text}\nb = 2\n")
    assert "geheim" not in shown
    assert shown.startswith("a = 1\n")
    assert shown.endswith("\nb = 2\n") or text.startswith("[")
    assert "•••" in shown


@pytest.mark.parametrize("text", ["password = geheim", "password geheim", 'password = "geheim', "a = [" * 100_000])
def test_what_is_no_toml_is_not_shown(text):
    with pytest.raises((ValueError, RecursionError)):
        masked(text)


def test_comments_are_not_shown():
    text = '# pin: 1\na = [ # ]\n  1, # pw\n]\n  # \'geheim\'\n"a#b" = "#c" # d "\n# e\n[x] # f\nb = 2#g'
    assert masked(text) == '\na = [\n  1,\n]\n"a#b" = "#c"\n[x]\nb = 2'


@pytest.mark.parametrize(
    "text",
    [
        'token = { file = "/etc/modbus-gateway/token" }',
        'password = { credential = "mqtt" }',
        '[mqtt.password]\nfile = "/etc/modbus-gateway/mqtt"\n[x]',
        'key = { credential = "web.key" }',
        'key = "/etc/modbus-gateway/tls/web.key"',
        'credentials = "/etc/modbus-gateway/fleet.creds"',
        'bind = "https://0.0.0.0:8502"',
        'to = "tcp://[2001:db8::1]:502"',
        'port = "/dev/ttyUSB0"',
        'name = "token ring"',
    ],
)
def test_all_else_is(text):
    assert masked(f"{text}\nb = 2\n") == f"{text}\nb = 2\n"


def test_of_all_keys_of_a_config_only_those_with_secrets_are_masked():
    keys = {key for model in Table.__subclasses__() for key in keys_of(model)}
    assert {key for key in keys if is_secret(key)} == {"password", "token"}


@pytest.mark.parametrize(
    "line",
    [
        "password = geheim",
        "passwort = geheim",
        "password: geheim",
        "password = 12345",
        "passwort = 12345",
        'password = "12345"',
        'password = ["12345"]',
        'password = { text = "12345" }',
        "password = \u201egeheim\u201c",
        'password = "geheim',
    ],
)
@pytest.mark.parametrize("table", ['[mqtt]\nbroker = "mqtt://127.0.0.1"', '[web]\nbind = "http://127.0.0.1:1"'])
def test_what_is_wrong_with_a_secret_is_said_without_it(table, line):
    line = line.replace("password", "token") if "web" in table else line
    found = parse(f"{table}\n{line}\n", "gateway.toml").problems
    assert found
    assert not any(secret in str(each) for each in found for secret in ("geheim", "12345"))


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        f"a = [{'1, ' * 30_000}]",
        f"a = 1{' ' * 100_000}",
        f"a = 1{chr(10) * 100_000}",
        f"a = '{'://' * 30_000}'",
        "'#' = 1\n" + "# '\n" * 30_000,
    ],
)
def test_no_file_takes_long(text):
    began = time.process_time()
    with suppress(ValueError, RecursionError):
        masked(text)
    assert time.process_time() - began < 5
