"""A config as it may be shown."""

import pytest

from gateway.config.masking import masked


@pytest.mark.parametrize(
    "text",
    [
        'password = "geheim"',
        'Password="geheim"',
        "mqtt_password = 'geheim'",
        '"password" = "geheim"',
        'password = """geheim\nand more"""',
        "password = '''\ngeheim'''",
        'password = "with \\" geheim"',
        'broker = { user = "anna", password = "geheim", port = 1883 }',
        'token = "geheim"',
        'client_secret = "geheim"',
        'to = "mqtt://anna:geheim@10.2.0.1"',
        '# password = "geheim"',
        "# the password: geheim",
        "key = '''\n-----BEGIN PRIVATE KEY-----\ngeheim\n-----END PRIVATE KEY-----\n'''",
    ],
)
def test_a_secret_is_not_shown(text):
    shown = masked(f"a = 1\n{text}\nb = 2\n")
    assert "geheim" not in shown
    assert shown.startswith("a = 1\n")
    assert shown.endswith("b = 2\n")
    assert "•••" in shown


@pytest.mark.parametrize(
    "text",
    [
        'token = "/etc/modbus-gateway/token"',
        'key = { credential = "web.key" }',
        'key = "/etc/modbus-gateway/tls/web.key"',
        'credentials = "/etc/modbus-gateway/fleet.creds"',
        'bind = "https://0.0.0.0:8502"',
        'to = "tcp://[2001:db8::1]:502"',
        'port = "/dev/ttyUSB0"   # by the door',
        'name = "token ring"',
    ],
)
def test_all_else_is(text):
    assert masked(f"{text}\nb = 2\n") == f"{text}\nb = 2\n"
