"""Configs of a program: a file, a text or a dict gives the same plan, or the same problems."""

import asyncio
import gc
import resource
import signal
import sys
import threading
import tomllib
from contextlib import suppress
from datetime import date
from enum import IntEnum, StrEnum
from pathlib import Path
from types import MappingProxyType

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.cli.main import main
from gateway.config.schema.config import Config
from gateway.config.schema.table import Table, keys_of, row_model
from gateway.errors import ConfigError
from gateway.library.reading_config import read_file, read_table, read_text
from kit.configs import accepted_configs

LINE = """\
[[line]]
name = "hall"
port = "/dev/null"
baud = 9600
format = "8E1"
devices = [{ unit = 1, name = "silo" }]
"""
WRONG = f"""\
{LINE}
[[line]]
name = "hall"
port = 5
buad = 9600
timeout = 5
devices = [{{ unit = 300 }}, {{ unit = 1, profile = "nobody" }}]
[[image]]
unit = 1
holding = 10
[mqtt]
broker = 1
[web]
bind = "http://192.0.2.77:8080"
"""


def from_text(text, folder=Path(), units=None):
    return read_text(text, folder, units or {}, has_state=True)


def from_dict(table, folder=Path(), units=None):
    return read_table(table, folder, units or {}, has_state=True)


def told(problems):
    """Problems without their places."""
    return sorted((one.severity, one.path, one.what, one.remedy, one.name) for one in problems)


def refused(make, *arguments, **more):
    with pytest.raises(ConfigError) as caught:
        make(*arguments, **more)
    return caught.value


# A dict


def test_a_dict_means_what_the_same_text_means():
    assert from_dict(tomllib.loads(LINE)).plan == from_text(LINE).plan


@given(accepted_configs())
def test_whatever_is_accepted_as_a_text_is_the_same_as_a_dict(text):
    as_text, as_dict = from_text(text), from_dict(tomllib.loads(text))
    assert as_dict.plan == as_text.plan
    assert [each[:3] for each in told(as_dict.problems)] == [each[:3] for each in told(as_text.problems)]


def test_problems_of_a_dict_name_the_key_and_no_line():
    as_text, as_dict = refused(from_text, WRONG), refused(from_dict, tomllib.loads(WRONG))
    assert len(as_dict.problems) > 6
    assert {(one.file, one.line, one.column) for one in as_dict.problems} == {("<dict>", 0, 0)}
    places = [(one[0], one[1]) for one in told(as_dict.problems)]
    assert places == [(one[0], one[1]) for one in told(as_text.problems)]
    assert '<dict>: error: line[1].port: must be text (line "hall")\n  help: put it in quotes: "5"' in str(as_dict)
    assert '1 is already a unit of line "hall" (line[0].devices[0])' in str(as_dict)


def test_a_dict_may_have_tuples_paths_and_enumerations(tmp_path):
    class Baud(IntEnum):
        FAST = 19200

    class Format(StrEnum):
        EVEN = "8E1"

    row = MappingProxyType({"unit": 1})
    line = {"port": Path("/dev/null"), "baud": Baud.FAST, "format": Format.EVEN, "devices": (row,)}
    plan = from_dict({"line": (line,), "control": {"socket": tmp_path / "c.sock"}}).plan
    assert plan.lines[0].port.port == "/dev/null"
    assert (plan.lines[0].line.timing.baud, plan.control) == (19200, str(tmp_path / "c.sock"))


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, "line[0].baud: cannot be None\n  help: leave the key out"),
        ({9600}, "line[0].baud: cannot be of the type set\n  help: write a dict"),
        (b"9600", "line[0].baud: cannot be of the type bytes"),
        (object(), "line[0].baud: cannot be of the type object"),
        (2**64, "line[0].baud: is a number of more than 64 bits"),
        ("\ud800", "line[0].baud: is not UTF-8 text"),
        ({1: 2}, "line[0].baud: has a key that is no text: '1'"),
        ([[None]], "line[0].baud[0][0]: cannot be None"),
        (date(2026, 1, 1), "line[0].baud: must be a whole number"),
        ("9600", "line[0].baud: must be a whole number\n  help: write it without quotes: baud = 9600"),
        (True, "line[0].baud: must be a whole number"),
        (float("nan"), "line[0].baud: must be a whole number"),
    ],
)
def test_a_value_of_a_wrong_type_is_told_by_its_key(value, said):
    table = tomllib.loads(LINE)
    table["line"][0]["baud"] = value
    assert f"<dict>: error: {said}" in str(refused(from_dict, table)).replace(' (line "hall")', "")


@pytest.mark.parametrize("value", [date(2026, 1, 1), 5, float("inf"), [date(2026, 1, 1)], {"a": [date(2026, 1, 1)]}])
def test_what_must_be_text_is_told_of_any_type(value):
    assert "line[0].port: must be text" in str(refused(from_dict, {"line": [{"port": value}], "site": "a"}))
    assert "site: must be text" in str(refused(from_dict, {"site": value}))


_TABLES = keys_of(Config) + [
    key for each in Config.model_fields.values() for key in keys_of(row_model(each.annotation) or Table)
]
_KEYS = st.sampled_from(sorted({*_TABLES, "holding", "x", "", "file", "unit"})) | st.text(max_size=3) | st.integers()
_VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=5)
    | st.binary(max_size=2)
    | st.dates()
    | st.sampled_from([2**63, "1 s", "/dev/null", "8E1", "a", Path("a"), set(), object, "\ud800", 9600, ()]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(_KEYS, inner, max_size=4),
    max_leaves=12,
)


@given(
    st.dictionaries(
        st.sampled_from(keys_of(Config)), _VALUES | st.lists(st.dictionaries(_KEYS, _VALUES, max_size=6), max_size=3)
    )
)
def test_whatever_is_in_a_dict_it_can_be_used_or_the_errors_are_told(table):
    with suppress(ConfigError):
        from_dict(table)


def test_a_dict_that_contains_itself_is_one_problem():
    table = {}
    table["line"] = [table]
    assert [str(one) for one in refused(from_dict, table).problems] == ["<dict>: error: is nested too deeply"]


def test_an_empty_dict_says_what_is_missing():
    assert "<dict>: error: there is no [[line]], and nothing else to serve" in str(refused(from_dict, {}))


def test_the_dict_is_neither_changed_nor_kept():
    table = tomllib.loads(LINE)
    found = from_dict(table)
    assert table == tomllib.loads(LINE)
    table["line"][0]["devices"].append({"unit": 2})
    table["line"][0]["baud"] = 19200
    again = found.read(found.file).plan
    assert (again, again.lines[0].line.timing.baud) == (found.plan, 9600)


@pytest.mark.parametrize("config", [None, "gateway.toml", [], Path("gateway.toml"), 5])
def test_what_is_no_table_is_a_type_error_that_names_the_other_ways(config):
    with pytest.raises(TypeError, match="from_toml takes a path, from_text a text"):
        from_dict(config)


# A text


@pytest.mark.parametrize("config", [None, b"", Path("gateway.toml"), {}])
def test_what_is_no_text_is_a_type_error(config):
    with pytest.raises(TypeError, match="from_text takes the text of a config, not"):
        from_text(config)


def test_problems_of_a_text_have_their_places():
    error = refused(from_text, "\ufeff" + LINE.replace("9600", '"9600"').replace("\n", "\r\n"))
    assert str(error) == (
        '<text>:4:8: error: line[0].baud: must be a whole number (line "hall")\n'
        "  help: write it without quotes: baud = 9600"
    )


@pytest.mark.parametrize(
    ("text", "said"), [("site = '\ud800'", "is not UTF-8 text"), ("#" * 2**20 + "#", "has more than 1048576 bytes")]
)
def test_what_could_be_no_file_is_no_text_either(text, said):
    assert str(refused(from_text, text)) == f"<text>: error: {said}"


@pytest.mark.parametrize("make", [from_text, lambda text, folder=Path(): from_dict(tomllib.loads(text), folder)])
def test_paths_and_own_profiles_are_looked_for_in_the_folder(make, tmp_path, monkeypatch):
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "meter.toml").write_text('[profile.meter]\npoints = [{ name = "power", holding = 1 }]\n')
    text = LINE.replace('name = "silo"', 'profile = "meter"') + '[control]\nsocket = "run/c.sock"\n'
    found = make(text, tmp_path)
    assert found.plan.control == str(tmp_path / "run" / "c.sock")
    assert list(found.profile_texts) == ["meter"]
    assert 'there is no profile "meter"' in str(refused(make, text))
    monkeypatch.chdir(tmp_path)
    assert make(text).plan == found.plan


def test_a_wrong_profile_is_told_with_its_file(tmp_path):
    (tmp_path / "profiles").mkdir()
    file = tmp_path / "profiles" / "meter.toml"
    file.write_text("[profile.meter]\npoints = 5\n")
    table = {"line": [{"port": "/dev/null", "baud": 9600, "format": "8E1", "profile": "meter"}]}
    assert str(refused(from_dict, table, tmp_path)).startswith(
        f"{file}:2:10: error: profile.meter.points: must be a list"
    )


# A file


def test_a_file_says_what_check_says(tmp_path, capsys):
    file = tmp_path / "gateway.toml"
    file.write_text(WRONG)
    error = refused(read_file, file, {}, has_state=True)
    assert main(["check", str(file)]) == 1
    printed = capsys.readouterr().out
    assert all(one.what in printed for one in error.problems)
    assert {one.severity for one in error.problems} == {"error", "warning"}
    assert str(error) == "\n".join(str(one) for one in error.problems if one.severity == "error")
    lines = [one.line for one in error.problems]
    assert lines == sorted(lines)


def test_a_file_that_is_not_there_is_a_problem(tmp_path):
    error = refused(read_file, tmp_path / "gateway.toml", {}, has_state=True)
    assert "there is no such file" in str(error)
    assert len(error.problems) == 1


def test_a_file_is_read_again_as_it_is_then(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text(LINE)
    found = read_file(str(file), {}, has_state=True)
    assert (found.fixed, found.text, found.file) == ("", LINE, file)
    file.write_text(LINE.replace("9600", "19200"))
    assert found.read(file).plan.lines[0].line.timing.baud == 19200
    file.write_text(WRONG)
    assert found.read(file).plan is None


# Nothing is left behind


def of_the_process():
    return (
        [signal.getsignal(each) for each in (signal.SIGALRM, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)],
        0 < signal.getitimer(signal.ITIMER_REAL)[0] < 100,  # pytest's own is longer
        [resource.getrlimit(each) for each in (resource.RLIMIT_CORE, resource.RLIMIT_DATA, resource.RLIMIT_NOFILE)],
        (gc.isenabled(), gc.get_threshold(), gc.get_freeze_count()),
        (list(sys.path), sys.getswitchinterval(), sys.getrecursionlimit(), sys.stdout, sys.stderr),
        threading.enumerate(),
    )


def test_reading_leaves_nothing_in_the_process(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text(LINE)
    before = of_the_process()
    read_file(file, {}, has_state=True)
    refused(from_text, WRONG)
    refused(from_dict, {"line": None})
    assert of_the_process() == before


async def test_reading_may_be_done_in_a_thread(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text(LINE)
    many = await asyncio.gather(*(asyncio.to_thread(read_file, file, {}, has_state=True) for _ in range(4)))
    assert len({one.plan.lines[0].name for one in many}) == 1


def test_only_a_file_includes_others(tmp_path):
    (tmp_path / "b.toml").write_text(LINE)
    (tmp_path / "gateway.toml").write_text('include = ["b.toml"]\n[[image]]\nunit = 200\nholding = 1\n')
    assert [line.line.name for line in read_file(tmp_path / "gateway.toml", {}, has_state=True).plan.lines] == ["hall"]
    said = "error: include: only a file includes others\n  help: Gateway.from_toml(PATH) reads one"
    assert str(refused(from_text, f'include = ["b.toml"]\n{LINE}')) == f"<text>: {said}"
    assert str(refused(from_dict, {"include": ["b.toml"], **tomllib.loads(LINE)})) == f"<dict>: {said}"
