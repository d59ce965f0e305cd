"""What TLS needs in a config, and what roles can match."""

import pytest

from gateway.config.load import parse
from gateway.config.problem import dotted

IMAGE = "[[image]]\nunit = 200\nholding = 10\n"
FILES = 'certificate = "/a/server.crt"\nkey = "/a/server.key"\nclients_ca = "/a/ca.crt"\n'
TLS = f'[[listen]]\nname = "far"\nbind = "tls://127.0.0.1"\n{FILES}'
ROLE = '[[access]]\nrole = "fitter"\nallow = ["read", "write"]\n'


def problems(text: str) -> list[str]:
    found = parse(IMAGE + text, "gateway.toml", port_trouble=lambda _: None, real_path=str).problems
    return [f"{one.severity}: {dotted(one.path)}: {one.what}" for one in found]


def test_a_listener_with_all_that_it_needs_is_fine() -> None:
    assert problems(TLS + ROLE) == []
    assert (
        problems(TLS.replace('"/a/server.key"', '{ credential = "server.key" }') + 'crl = "/a/ca.crl"\n' + ROLE) == []
    )


def test_what_is_missing_is_named() -> None:
    assert problems('[[listen]]\nbind = "tls://127.0.0.1"\nkey = "/a/server.key"\n' + ROLE) == [
        "error: listen[0].bind: tls:// needs certificate, clients_ca"
    ]
    upstream = '[[upstream]]\nto = "tls://10.0.0.1"\nunits = [{ as = 2, unit = 2 }]\ncertificate = "/a/gw.crt"\n'
    assert problems(upstream) == ["error: upstream[0].to: tls:// needs key, ca"]


def test_what_only_tls_has_use_for() -> None:
    assert problems(f'[[listen]]\nbind = "tcp://127.0.0.1"\n{FILES}crl = "/a/ca.crl"\n') == [
        f"error: listen[0].{key}: is used only with tls://" for key in ("certificate", "key", "clients_ca", "crl")
    ]
    upstream = '[[upstream]]\nto = "tcp://10.0.0.1"\nunits = [{ as = 2, unit = 2 }]\nserver_name = "plc"\n'
    assert problems(upstream) == ["error: upstream[0].server_name: is used only with tls://"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (ROLE, "no listener with tls:// is there, so the row never matches"),
        (
            TLS + '[[listen]]\nname = "near"\nbind = "tcp://127.0.0.1"\n' + ROLE + 'listen = ["near"]\n',
            "none of these listeners has tls://, so the row never matches",
        ),
    ],
)
def test_a_role_that_nobody_can_have(text: str, said: str) -> None:
    assert f"warning: access[0].role: {said}" in problems(text)


def test_a_row_that_does_not_name_the_listener_gives_its_clients_nothing() -> None:
    row = '[[access]]\nfrom = ["127.0.0.1"]\nallow = ["read"]\n'
    what = "no row of [[access]] gives its clients any right: a row without role must name the listener"
    assert problems(TLS + row) == [f"warning: listen[0].bind: {what}"]
    assert problems(TLS + row + 'listen = ["far"]\n') == []


def test_without_rows_it_is_said_that_clients_only_read() -> None:
    said = "TLS clients may only read without [[access]], whatever their roles"
    assert problems(TLS) == [f"warning: listen[0].bind: {said}"]


@pytest.mark.parametrize("role", ["a\\nb", 65 * "a"])
def test_a_role_is_visible_text(role: str) -> None:
    assert problems(f'{TLS}[[access]]\nrole = "{role}"\nallow = []\n') == [
        "error: access[0].role: must have at most 64 visible characters"
    ]


def test_a_row_that_does_not_count_for_certificates_hides_none_that_does() -> None:
    everybody = '[[access]]\nallow = ["read"]\n'
    assert problems(TLS + everybody + ROLE) == []
    (said,) = problems(
        TLS + everybody.replace("allow", 'listen = ["far"]\nallow') + ROLE.replace("allow", 'listen = ["far"]\nallow')
    )
    assert "never matches" in said
