"""Lines of a config that a message may quote: none with a secret, or a part of one."""

import pytest

from gateway.config.reading.excerpt import Excerpts

WHOLE = '''\
[[line]]
port = "/dev/ttyUSB0"
[mqtt]
user = "gw"
password = { file = "/etc/mqtt" }
broker = "mqtts://gw:hunter2@plant"
[other]
# the old token was hunter2
note = """
first
-----BEGIN PRIVATE KEY-----
hunter2
"""
[mqtt.secrets]
one = "hunter2"
'''


def test_lines_with_secrets_are_not_quoted() -> None:
    shown = [line for number in range(-1, 99) if (line := Excerpts(WHOLE).line(number)) is not None]
    assert shown == ["[[line]]", 'port = "/dev/ttyUSB0"', "[mqtt]", 'user = "gw"', "[other]", ""]


@pytest.mark.parametrize(
    "text",
    [
        'pasword = "hunter2',
        'passwords = [\n"a",\n"hunter2',
        'passwords = [\n["hunter2"],\n"x',
        'pwd = """\nfine = 1\nhunter2 """ = x',
        "token = '''\nfine = 1\nhunter2",
        '[mqtt.secret]\na = 1\nvalue = "hunter2',
        'x = {password =\n"hunter2',
        'broker = "mqtt://a:hunter2@b',
        '"api key" = 1\nkennwort: "hunter2"',
    ],
)
def test_of_a_text_that_is_no_toml_doubtful_lines_are_not_quoted(text: str) -> None:
    excerpts = Excerpts(text)
    assert all("hunter2" not in (excerpts.line(number) or "") for number in range(1, text.count("\n") + 2))


def test_other_lines_of_such_a_text_are_quoted() -> None:
    text = '[mqtt]\npassword = "hunter2"\n[[line]]\nport = "/dev/ttyUSB0'
    assert Excerpts(text).line(4) == 'port = "/dev/ttyUSB0'
    assert Excerpts(text).line(3) == "[[line]]"
