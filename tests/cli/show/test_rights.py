"""The rights that `check` prints."""

import json
from pathlib import Path
from textwrap import dedent

import pytest

from gateway.cli.main import main

FILE = """\
[[listen]]
name = "scada"
bind = "tcp://0.0.0.0:1502"

[[listen]]
name = "field"
bind = "udp://0.0.0.0:1502"

[[image]]
unit    = 41
holding = 10

[[line]]
name   = "panel"
port   = "/dev/null"
role   = "server"
serves = 41
"""
ROWS = """\
[[access]]
from  = ["10.2.0.66"]
allow = []

[[access]]
from  = ["10.2.0.0/24", "fd00::/8"]
units = ["41-43", 46]
allow = ["read", "write"]

[[access]]
listen    = ["scada"]
functions = [3, 16, 43]

[[access]]
from  = ["10.3.0.0/24"]
allow = ["write"]
"""


def rights(folder: Path, capsys: pytest.CaptureFixture[str], text: str) -> str:
    """The paragraph about rights."""
    file = folder / "gateway.toml"
    file.write_text(text)
    main(["check", str(file)])
    said = capsys.readouterr().out
    return said[said.index("Rights") :].partition("\n\n")[0]


MQTT = """
[mqtt]
broker  = "mqtt://127.0.0.1"
publish = [{{ device = "tank", every = "1 s" }}]
{more}
[profile.tank]
points = [{{ name = "level", holding = 1, write = true }}]
"""


@pytest.mark.parametrize(
    ("more", "row"),
    [
        ("", ["the broker mqtt 41 read"]),
        ("write = true\n", ["the broker mqtt 41 read, write"]),
        ('[[access]]\nlisten = ["mqtt"]\nallow = ["read"]\n', []),
    ],
)
def test_a_broker_that_no_row_names_does_what_mqtt_allows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str, row: list[str]
) -> None:
    tank = 'holding = 10\nname = "tank"\nprofile = "tank"'
    text = f'site = "plant"\n{FILE.replace("holding = 10", tank)}{ROWS}{MQTT.format(more=more)}'
    table = rights(tmp_path, capsys, text).splitlines()
    assert [" ".join(each.split()) for each in table if "the broker" in each] == row


@pytest.mark.parametrize(
    ("more", "rows"),
    [
        ("", ["other users of the page web all read"]),
        ('write = true\nusers = "/u"\n', ["operators web all read, write", "other users of the page web all read"]),
        ('[[access]]\nlisten = ["web"]\nallow = ["read"]\n', ["anywhere web all read"]),
    ],
)
def test_operators_of_a_web_page_that_no_row_names_do_what_web_allows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str, rows: list[str]
) -> None:
    web = f'\n[web]\nbind = "http://127.0.0.1:8502"\n{more}'
    table = rights(tmp_path, capsys, f'{FILE}{web}[[access]]\nallow = ["read"]\n').splitlines()
    assert [" ".join(each.split()) for each in table if " web " in each] == rows


def test_a_control_socket_that_a_row_names_does_what_the_row_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = rights(tmp_path, capsys, FILE + '[[access]]\nlisten = ["control"]\nallow = ["read"]\n').splitlines()
    assert [" ".join(each.split()) for each in table if " control " in each] == ["anywhere control all read"]


CLOCK = """
from gateway import CustomUnit
class Clock(CustomUnit):
    async def read(self, area, address, count):
        return [0] * count
"""


@pytest.mark.parametrize(
    ("more", "row"),
    [
        ("", ["units made in Python embedded all read, write"]),
        ('[[access]]\nlisten = ["embedded"]\nallow = ["read"]\n', ["anywhere embedded all read"]),
    ],
)
def test_units_in_python_may_ask_all_others_until_a_row_names_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str, row: list[str]
) -> None:
    (tmp_path / "clock_of_rights.py").write_text(CLOCK)
    table = rights(tmp_path, capsys, f'{FILE}[[image]]\nunit = 60\npython = "clock_of_rights:Clock"\n{more}')
    assert [" ".join(each.split()) for each in table.splitlines() if " embedded " in each] == row


def test_without_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rights(tmp_path, capsys, FILE) == dedent(
        """\
        Rights: first match wins
          FROM             THROUGH       UNITS  RIGHTS
          this machine     any listener  all    read, write
          anywhere         any listener  all    read
          the line         panel         41     read, write, broadcast
          who may open it  control       all    read, write
          Through field (UDP) clients only read, as no row names it."""
    )


def test_with_rows(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert rights(tmp_path, capsys, FILE + ROWS) == dedent(
        """\
        Rights: first match wins
          FROM                   THROUGH       UNITS      RIGHTS
          10.2.0.66              any listener  all        nothing
          10.2.0.0/24, fd00::/8  any listener  41-43, 46  read, write
          anywhere               scada         all        functions 3, 16, 43
          10.3.0.0/24            any listener  all        write
          all else                                        nothing
          the line               panel         41         read, write, broadcast
          who may open it        control       all        read, write
          Through field (UDP) clients only read, as no row names it."""
    )


def test_what_a_row_names_is_in_the_table_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    row = '[[access]]\nlisten = ["panel", "field"]\nallow = ["read"]\n'
    assert rights(tmp_path, capsys, FILE + row) == dedent(
        """\
        Rights: first match wins
          FROM             THROUGH       UNITS  RIGHTS
          anywhere         field, panel  all    read
          all else                              nothing
          who may open it  control       all    read, write"""
    )


def test_for_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text(FILE + ROWS)
    main(["check", "--json", str(file)])
    _, some, functions, _ = json.loads(capsys.readouterr().out)["rights"]
    assert some == {
        "from": ["10.2.0.0/24", "fd00::/8"],
        "role": None,
        "listen": None,
        "units": [41, 42, 43, 46],
        "by_address": False,
        "addresses": None,
        "may": "read, write",
        "priority": "normal",
        "source": "gateway.toml:22",
    }
    assert (functions["from"], functions["listen"], functions["may"]) == (None, ["scada"], "functions 3, 16, 43")


def test_units_of_a_listener_for_one_line_are_those_on_the_wire(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hall = '[[listen]]\nname = "hall"\nbind = "tcp://127.0.0.1:1503"\nline = "zero"\n[[line]]\nport = "/dev/zero"\n'
    rows = '[[access]]\nlisten = ["hall"]\nunits = 1\nallow = ["read"]\n[[access]]\nlisten = ["hall"]\nallow = []\n'
    assert rights(tmp_path, capsys, FILE + hall + rows).splitlines()[2:4] == [
        "  anywhere         hall     1 on the wire  read",
        "  anywhere         hall     all            nothing",
    ]
    main(["check", "--json", str(tmp_path / "gateway.toml")])
    assert [row["by_address"] for row in json.loads(capsys.readouterr().out)["rights"]] == [True, True]


def test_units_of_a_listener_for_one_upstream_are_those_of_the_server(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    roof = '[[listen]]\nname = "roof port"\nbind = "tcp://127.0.0.1:1503"\nupstream = "roof"\n'
    roof += '[[upstream]]\nname = "roof"\nto = "tcp://10.1.0.5"\n'
    row = '[[access]]\nlisten = ["roof port"]\nunits = [0, 250]\nallow = ["read"]\n'
    said = rights(tmp_path, capsys, FILE + roof + row).splitlines()
    assert said[2] == "  anywhere         roof port  0, 250 at the server  read"


def test_roles_are_shown_and_what_tls_clients_have_without(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tls = '[[listen]]\nname = "far"\nbind = "tls://0.0.0.0"\ncertificate = "/x"\nkey = "/x"\nclients_ca = "/x"\n'
    rows = '[[access]]\nrole = "fitter"\nallow = ["write"]\n[[access]]\nrole = ""\nallow = ["read"]\n'
    said = rights(tmp_path, capsys, FILE + tls + rows).splitlines()
    assert said[2:5] == [
        '  anywhere, role "fitter"   any listener  all    write',
        "  anywhere, without a role  any listener  all    read",
        "  all else                                       nothing",
    ]
    assert said[-1] == "  Through far (TLS) only rows with a role apply, as no row names it."
    assert rights(tmp_path, capsys, FILE + tls).splitlines()[-1] == (
        "  Through far (TLS) clients only read, from everywhere, as there are no rows."
    )


ADDRESSES = """\
[[access]]
holding = ["0-0x63", "120"]
coils   = "7"
allow   = ["read"]

[[access]]
from     = ["10.2.0.7"]
units    = 41
allow    = ["read", "write"]
priority = "high"

"""


def test_addresses_have_a_column_if_a_row_names_some_and_so_has_priority(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rights(tmp_path, capsys, FILE + ADDRESSES + ROWS[: ROWS.index("\n\n") + 1]) == dedent(
        """\
        Rights: first match wins
          FROM             THROUGH       UNITS  ADDRESSES                   RIGHTS                  PRIORITY
          anywhere         any listener  all    coils 7; holding 0-99, 120  read
          10.2.0.7         any listener  41     all                         read, write             high
          10.2.0.66        any listener  all    all                         nothing
          all else                                                          nothing
          the line         panel         41     all                         read, write, broadcast
          who may open it  control       all    all                         read, write
          At each address of a request the first row that has it counts, and each of these rows must allow the function.
          What may write and tells no addresses is also refused by an earlier row for addresses that does not allow it.
          Through field (UDP) clients only read, as no row names it."""
    )


def test_addresses_and_priority_for_programs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "gateway.toml"
    file.write_text(FILE + ADDRESSES)
    main(["check", "--json", str(file)])
    by_address, other = json.loads(capsys.readouterr().out)["rights"]
    assert by_address["addresses"] == {"coils": [[7, 7]], "holding": [[0, 99], [120, 120]]}
    assert (by_address["priority"], other["addresses"], other["priority"]) == ("normal", None, "high")


def test_a_row_for_addresses_leaves_others_to_nobody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = rights(tmp_path, capsys, FILE + '[[access]]\nholding = "0-99"\nallow = ["read"]\n')
    assert [line.split() for line in said.splitlines() if "all else" in line] == [["all", "else", "nothing"]]
