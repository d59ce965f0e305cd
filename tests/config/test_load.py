"""From a file to a config, or to everything that is wrong with it."""

import errno
import os
from pathlib import Path
from textwrap import dedent

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.config.load import load, parse
from gateway.config.reading.profile_file import shipped_profile
from gateway.config.resolve import resolve
from gateway.config.schema.config import Config
from gateway.config.schema.table import Table, keys_of, row_model

SMALLEST = '[[line]]\nport = "/dev/ttyUSB0"\nbaud = 9600\nformat = "8E1"\n'

NO_QUOTE = "error: the text has no closing quote\n  help: put the quote that it begins with at its end too"


def problems(text):
    """What is said about `text` where every port exists."""
    loaded = parse(dedent(text), "gateway.toml", port_trouble=lambda _: None, real_path=str)
    assert (loaded.config is None) == any(problem.severity == "error" for problem in loaded.problems)
    return [str(problem) for problem in loaded.problems]


def test_the_smallest_useful_file_is_fine():
    assert problems(SMALLEST) == []


def test_every_problem_is_reported_with_its_place_and_what_to_do():
    assert problems(
        """\
        [[lin]]
        x = 1

        [[line]]
        port = 5
        buad = 9600
        format = 8E1
        timeout = 5
        devices = [
          { unit = 1, As = 4, profile = 3 },
          { unit = "1-300" }, 5,
        ]

        [web]
        """
    ) == [
        'gateway.toml:1:1: error: lin: unknown key\n  help: did you mean "line"?',
        'gateway.toml:5:8: error: line[0].port: must be text\n  help: put it in quotes: "5"',
        'gateway.toml:6:1: error: line[0].buad: unknown key\n  help: did you mean "baud"?',
        'gateway.toml:7:10: error: line[0].format: must be text\n  help: put it in quotes: "8E1"',
        (
            "gateway.toml:8:11: error: line[0].timeout: a duration needs a unit\n"
            '  help: put it in quotes with a unit: "5 ms" or "5 s"'
        ),
        (
            "gateway.toml:10:15: error: line[0].devices[0].As: unknown key\n"
            "  help: known here: unit, as, name, profile, priority, timeout, wake, points"
        ),
        'gateway.toml:10:33: error: line[0].devices[0].profile: must be text\n  help: put it in quotes: "3"',
        "gateway.toml:11:12: error: line[0].devices[1].unit: unit 300 is outside 1-255",
        "gateway.toml:11:23: error: line[0].devices[2]: must be a table",
        "gateway.toml:14:1: error: web.bind: bind is missing",
    ]


NOT_ON_ONE_LINE = (
    "error: invalid initial character for a key part\n"
    "  help: a table in { } is on one line; a long one: [[line.devices]], [[profile.NAME.points]], a key a line"
)
NO_SIGN = "error: a key and its value have = between them\n  help: write"
NO_END = "error: the list that begins here has no ] at its end"
BRACKETS = "error: brackets are missing in this header, or too many\n  help"
NO_COMMA = "error: unclosed array\n  help: a comma is missing before this"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            '[[line]]\nport = "/dev/x"\nformat = 8N1\n',
            (
                "gateway.toml:3:11: error: expected newline or end of document after a statement\n"
                '  help: put the value in quotes: format = "8N1"'
            ),
        ),
        (
            "[[line]]\nrest = \u201c5 s\u201d\n",
            'gateway.toml:2:8: error: invalid value\n  help: put the value in straight quotes: rest = "5 s"',
        ),
        (
            "[[line]]\nport = /dev/ttyUSB0\n",
            'gateway.toml:2:8: error: invalid value\n  help: put the value in quotes: port = "/dev/ttyUSB0"',
        ),
        (
            '[[line]]\ndevices = [{ unit = 1, name = "a", timeout = 5 s }]\n',
            'gateway.toml:2:48: error: unclosed inline table\n  help: put the value in quotes: timeout = "5 s"',
        ),
        (
            "[[line]]\nbaud = 1920O\n",
            (
                "gateway.toml:2:12: error: expected newline or end of document after a statement\n"
                "  help: baud is a number: digits only, not 1920O"
            ),
        ),
        (
            "[[listen]]\nidle = 10 min\n",
            (
                "gateway.toml:2:11: error: expected newline or end of document after a statement\n"
                '  help: put the value in quotes: idle = "10 min"'
            ),
        ),
        (
            "[[line]]\ndevices = [{ unit = 10-13 }]\n",
            'gateway.toml:2:23: error: unclosed inline table\n  help: put the value in quotes: unit = "10-13"',
        ),
        ("site = 1\nsite = 2", "gateway.toml:2:9: error: this key is there twice"),
        (
            "[line]\n[line]\n",
            "gateway.toml:2:6: error: [line] is there twice\n  help: write [[line]] if there are several",
        ),
        ('site = "a', f"gateway.toml:1:10: {NO_QUOTE}"),
        ('site = "a\n[[line]]\n', f"gateway.toml:1:10: {NO_QUOTE}"),
        ("site = 'a\n[log]\nlevel = 'info'\n", f"gateway.toml:1:10: {NO_QUOTE}"),
        (
            '[[line]]\nport: "/dev/ttyUSB0"\n',
            ('gateway.toml:2:5: error: a key and its value have = between them\n  help: write port = "/dev/ttyUSB0"'),
        ),
        ("[[line]]\nbaud 9600\n", f"gateway.toml:2:6: {NO_SIGN} baud = 9600"),
        ('[[line]]\nport "/dev/x"\n', f'gateway.toml:2:6: {NO_SIGN} port = "/dev/x"'),
        ("[[line]]\nport: /dev/x\n", f'gateway.toml:2:5: {NO_SIGN} port = "/dev/x"'),
        ("[web]\ntoken abc\n", f'gateway.toml:2:7: {NO_SIGN} token = "..."'),
        (
            "[[line]]\nserial number = 5\n",
            "gateway.toml:2:8: error: expected '=' after a key in a key/value pair",
        ),
        ("site = [1,\n", f"gateway.toml:1:8: {NO_END}"),
        ("[[line]]\necho = True\n", "gateway.toml:2:8: error: invalid value\n  help: write echo = true"),
        ("[[line]]\necho = no\n", "gateway.toml:2:8: error: invalid value\n  help: write echo = false"),
        ("[[line]]\necho = maybe\n", "gateway.toml:2:8: error: invalid value\n  help: write echo = true, or false"),
        ("// hall\n", "gateway.toml:1:1: error: invalid statement\n  help: comments begin with #"),
        ("; hall\n", "gateway.toml:1:1: error: invalid statement\n  help: comments begin with #"),
        (
            "[[line]]\nbaud = 9600 // slow\n",
            (
                "gateway.toml:2:13: error: expected newline or end of document after a statement\n"
                "  help: comments begin with #"
            ),
        ),
        ("[[line]]\ndevices = [\n  { unit = 1,\n    as = 2 },\n]\n", f"gateway.toml:3:14: {NOT_ON_ONE_LINE}"),
        ("[[line]]\ndevices = [{  # both\n  unit = 1 }]\n", f"gateway.toml:2:15: {NOT_ON_ONE_LINE}"),
        ("[[line]]\ndevices = [\n  { unit = 1 }\n  { unit = 2 },\n]\n", f"gateway.toml:4:3: {NO_COMMA}"),
        ("[[line]]\ndevices = [{ unit = 1 } { unit = 2 }]\n", f"gateway.toml:2:25: {NO_COMMA}"),
        (
            "[[line]]\ndevices = [{ unit = 1 as = 2 }]\n",
            "gateway.toml:2:23: error: unclosed inline table\n  help: a comma is missing before this",
        ),
        (
            "[[line]]\ndevices = [\n  { unit = 1 }\n\n[[listen]]\n",
            f"gateway.toml:2:11: {NO_END}",
        ),
        ("[[line]]\ndevices = [\n  { unit = 1 },\n\n[[image]]\nunit = 3\n", f"gateway.toml:2:11: {NO_END}"),
        ("[[access]]\nallow = ['read', # the [ is\nunits = 'all'\n", f"gateway.toml:2:9: {NO_END}"),
        ("[[line]]\ndevices = [{ unit = 1 }\n", f"gateway.toml:2:11: {NO_END}"),
        (
            "[[line]]\ndevices = [\n  { unit = 1, points = [{ name = 'a', holding = 1 } },\n]\n",
            "gateway.toml:3:53: error: unclosed array\n  help: the list before this has no ] at its end",
        ),
        (
            "site = 'a'\n[line]\nport = '/dev/x'\n\n[[line]]\nport = '/dev/y'\n",
            (
                "gateway.toml:2:1: error: [line] is one table, but line 5 has [[line]], one of several\n"
                "  help: write [[line]] here too"
            ),
        ),
        ("[[line\nport = '/dev/x'\n", f"gateway.toml:1:1: {BRACKETS}: write [[line]]"),
        ("[[line]\nport = '/dev/x'\n", f"gateway.toml:1:1: {BRACKETS}: write [[line]]"),
        ("[web # page\nbind = 'x'\n", f"gateway.toml:1:1: {BRACKETS}: write [web]"),
        ("[web]]\nbind = 'x'\n", f"gateway.toml:1:1: {BRACKETS}: write [web]"),
        ("[line]]\nport = '/dev/x'\n", f"gateway.toml:1:1: {BRACKETS}: write [[line]]"),
        ("[[web]\nbind = 'x'\n", f"gateway.toml:1:1: {BRACKETS}: write [web]"),
    ],
)
def test_what_is_no_toml_is_shown_with_its_place(text, said):
    assert problems(text) == [said]


def test_a_number_that_python_refuses_is_a_problem_too():
    (said,) = problems("site = " + "1" * 5000)
    assert said.startswith("gateway.toml:1:1: error: Exceeds the limit")


def test_a_file_that_is_nested_too_deeply_is_a_problem_too():
    assert problems("site = " + "[" * 5000 + "]" * 5000) == ["gateway.toml:1:1: error: is nested too deeply"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("site = 4", 'gateway.toml:1:8: error: site: must be text\n  help: put it in quotes: "4"'),
        ("site = [4]", "gateway.toml:1:8: error: site: must be text"),
        (
            "[line]",
            "gateway.toml:1:1: error: line: is a list of tables\n  help: write [[line]] with two brackets",
        ),
        ("[[log]]", "gateway.toml:1:1: error: log: is one table, not a list\n  help: write [log] with one bracket"),
        ("profile = 3", "gateway.toml:1:11: error: profile: is a table of tables\n  help: write [profile.NAME]"),
        ("profile.x = 3", "gateway.toml:1:13: error: profile.x: must be a table"),
        ("web = 3", "gateway.toml:1:7: error: web: must be a table"),
        (
            "[log]\nlevel = 'loud'",
            'gateway.toml:2:9: error: log.level: must be "debug", "info", "warning" or "error"',
        ),
        ("[profile.x]\nmargin = 0", "gateway.toml:2:10: error: profile.x.margin: must be at least 1"),
        ("[profile.x]\nmargin = 'a'", "gateway.toml:2:10: error: profile.x.margin: must be a number"),
        ("[profile.x]\nidle_chars = 0", "gateway.toml:2:14: error: profile.x.idle_chars: must be more than 0"),
        ("[profile.x]\nfunctions = 3", "gateway.toml:2:13: error: profile.x.functions: must be a list"),
        ("[profile.x]\ntitle = ['a']", "gateway.toml:2:9: error: profile.x.title: must be text"),
        (
            "[[image]]\nunit = '5'",
            "gateway.toml:2:8: error: image[0].unit: must be a whole number\n  help: write it without quotes: unit = 5",
        ),
        ("[[image]]\nunit = 1.5", "gateway.toml:2:8: error: image[0].unit: must be a whole number"),
        ("[[image]]\nunit = '1.5'", "gateway.toml:2:8: error: image[0].unit: must be a whole number"),
        ("[[image]]\nunit = 'x'", "gateway.toml:2:8: error: image[0].unit: must be a whole number"),
        (
            "[[line]]\nname = 'motion'\nport = '/dev/x'\nmode = 'ASCII'",
            (
                'gateway.toml:4:8: error: line[0].mode: must be "rtu" or "ascii" (line "motion")\n'
                '  help: did you mean "ascii"?'
            ),
        ),
        (
            "[[line]]\nport = '/dev/x'\necho = 'yes'",
            "gateway.toml:3:8: error: line[0].echo: must be true or false, without quotes\n  help: write echo = true",
        ),
        (
            "[[line]]\nport = '/dev/x'\nbaud = 19.2",
            ("gateway.toml:3:8: error: line[0].baud: must be a whole number\n  help: in bits per second: baud = 19200"),
        ),
        (
            "[[line]]\nport = '/dev/x'\nrole = 'slave'",
            (
                'gateway.toml:3:8: error: line[0].role: must be "client", "server" or "monitor"\n'
                '  help: did you mean "server"?'
            ),
        ),
        (
            "[[line]]\nport = '/dev/x'\nrole = 'master'",
            (
                'gateway.toml:3:8: error: line[0].role: must be "client", "server" or "monitor"\n'
                '  help: did you mean "client"?'
            ),
        ),
        (
            "[[access]]\nallow = 'write'",
            'gateway.toml:2:9: error: access[0].allow: must be a list\n  help: put it in brackets: allow = ["write"]',
        ),
        (
            "[[line]]\nport = '/dev/x'\ndevices = { unit = 1 }",
            (
                "gateway.toml:3:11: error: line[0].devices: must be a list\n"
                "  help: put it in brackets: devices = [{ ... }]"
            ),
        ),
        (
            "[[image]]\nunit = 5\ncoils = 3\ninitial.coil = []",
            'gateway.toml:4:9: error: image[0].initial.coil: unknown key\n  help: did you mean "coils"?',
        ),
        (
            "[profile.x]\nlimits = { x = 9 }",
            (
                'gateway.toml:2:10: error: profile.x.limits: "x" is not a valid function number\n'
                "  help: functions are numbered 1 to 127"
            ),
        ),
    ],
)
def test_a_value_of_the_wrong_kind_is_said_in_plain_words(text, said):
    assert problems(text) == [said]


@pytest.mark.parametrize(
    ("section", "key", "remedy"),
    [
        *[
            ("line", key, 'it is part of format, such as format = "8E1": data bits, parity, stop bits')
            for key in ("parity", "stopbits", "bytesize", "databits", "Data_Bits")
        ],
        ("line", "speed", 'did you mean "baud"?'),
        ("line", "baudrate", 'did you mean "baud"?'),
        ("line", "units", 'did you mean "devices"?'),
        ("line", "slaves", 'did you mean "devices"?'),
        ("line", "protocol", 'did you mean "mode"?'),
        ("line", "type", 'did you mean "mode"?'),
        ("image", "slave", 'did you mean "unit"?'),
        ("image", "slave_id", 'did you mean "unit"?'),
        ("listen", "address", 'did you mean "bind"?'),
        ("upstream", "address", 'did you mean "to"?'),
    ],
)
def test_what_other_programs_call_a_key_is_understood(section, key, remedy):
    assert f"error: {section}[0].{key}: unknown key\n  help: {remedy}" in "\n".join(
        problems(f"[[{section}]]\n{key} = 1\n")
    )


@pytest.mark.parametrize("key", ["slave", "slave_id", "address", "id"])
def test_what_other_programs_call_a_unit_is_understood(key):
    said = problems(f'[[line]]\nport = "/dev/x"\ndevices = [{{ unit = 1, {key} = 5 }}]\n')
    assert said == [f'gateway.toml:3:24: error: line[0].devices[0].{key}: unknown key\n  help: did you mean "unit"?']


@pytest.mark.parametrize("table", ["[[line]]", "[mqtt]", "[fleet]"])
def test_a_site_below_the_first_table_is_told_its_place(table):
    remedy = "site stands at the top of the file, before the first [table]"
    assert f".site: unknown key\n  help: {remedy}" in "\n".join(problems(f'{table}\nsite = "plant-1"\n'))


MANY = "9" * 4000


@pytest.mark.parametrize(
    "text",
    [
        f"[[image]]\nunit = {MANY}\ncoils = 1\n",
        f"[[image]]\nunit = 0x{MANY}\ncoils = 1\n",
        f'[[image]]\nunit = 1\nholding = "{MANY}{MANY}"\n',
        f"[[image]]\nunit = 1\nholding = 0x{MANY}{MANY}\n",
        f'[[line]]\nport = "/dev/x"\ndevices = [{{ unit = "{MANY}{MANY}" }}]\n',
        f'[[line]]\nport = "/dev/x"\ndevices = [{{ unit = 0x{MANY}{MANY} }}]\n',
        f'[[line]]\nport = "/dev/x"\ntimeout = 0x{MANY}{MANY}\n',
        f'[[line]]\nport = "/dev/x"\ntimeout = "{MANY}{MANY} s"\n',
        f'[[line]]\nport = "/dev/x"\n[[listen]]\nbind = "tcp://127.0.0.1:{MANY}{MANY}"\n',
        f'[[line]]\nport = "/dev/x"\n[profile.x]\nlimits = {{ {MANY}{MANY} = 1 }}\n',
    ],
)
def test_a_number_with_thousands_of_digits_is_one_problem(text):
    (said,) = problems(text)
    assert "error" in said


def test_one_broken_table_hides_no_problem_of_another_and_causes_none():
    """The unit 99 might be one of the line that failed, and the profile the one that failed: nobody complains."""
    assert problems(
        """\
        [[line]]
        port = "relative"
        [[line]]
        port = "/dev/y"
        format = "7E1"
        devices = [{ unit = 1, profile = "x" }]
        [[listen]]
        bind = "tcp://127.0.0.1:502"
        unit0 = 99
        [profile.x]
        margin = 0
        """
    ) == [
        (
            'gateway.toml:2:8: error: line[0].port: "relative" is not an absolute path\n'
            '  help: did you mean "/dev/relative"?'
        ),
        'gateway.toml:5:10: error: line[1].format: RTU needs 8 data bits\n  help: write "8E1", or mode = "ascii"',
        "gateway.toml:11:10: error: profile.x.margin: must be at least 1",
    ]


def test_every_table_knows_its_line_of_the_file():
    config = parse(
        '[[line]]\nport = "/dev/a"\ndevices = [\n  { unit = 1 },\n  { unit = 2 },\n]\n[profile.x]\n[log]\n',
        "/etc/modbus-gateway/gateway.toml",
        port_trouble=lambda _: None,
    ).config
    assert config is not None
    assert config.line[0].place == "gateway.toml:1"
    assert [row.place for row in config.line[0].devices] == ["gateway.toml:4", "gateway.toml:5"]
    assert config.line[0].devices[1].path == ("line", 0, "devices", 1)
    assert config.profile["x"].place == "gateway.toml:7"
    assert config.log.place == "gateway.toml:8"


def test_a_file_adds_profiles_and_replaces_shipped_ones():
    text = SMALLEST + 'devices = [{ unit = 1, profile = "v80" }]\n[profile.mint]\ntitle = "mine"\n[profile.own]\n'
    config = parse(text, port_trouble=lambda _: None).config
    assert config is not None
    assert set(config.profile) == {"generic", "v80", "mint", "own"}  # those that are used, and those of the file
    assert (config.profile["mint"].title, config.profile["mint"].functions) == ("mine", None)
    assert config.profile["v80"].place == "shipped"


def test_the_shipped_profiles_say_what_the_documents_say():
    profiles = {name: shipped_profile(name).table for name in ("generic", "mint", "v80", "weigher")}
    assert profiles["mint"].limits == {3: 99}
    assert profiles["mint"].holding == ((1, 99),)
    assert profiles["v80"].idle_chars == 4.5
    assert profiles["weigher"].functions == (3, 16)
    assert profiles["generic"].functions is None


def test_lines_may_end_as_on_windows_and_a_byte_order_mark_may_lead(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_bytes(b"\xef\xbb\xbf" + SMALLEST.replace("\n", "\r\n").encode())
    loaded = load(file)
    assert (loaded.errors, loaded.text) == ((), SMALLEST)


def test_a_file_is_read(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text('[[line]]\nport = "/dev/null"\n', encoding="utf-8")
    loaded = load(file)
    assert loaded.problems == ()
    assert loaded.config is not None


def test_a_file_that_does_not_exist_is_one_problem(tmp_path):
    file = tmp_path / "gateway.toml"
    (problem,) = load(file).problems
    help_ = "create it, or name another file; `modbus-gateway` alone prints one to begin with"
    assert str(problem) == f"{file}: error: there is no such file\n  help: {help_}"
    assert load(str(file)).config is None


@pytest.mark.parametrize(
    ("make", "what"),
    [(Path.mkdir, "a directory"), (os.mkfifo, "a FIFO"), (lambda file: file.symlink_to("/dev/zero"), "a device")],
)
def test_what_is_no_file_is_one_problem_and_not_waited_for(tmp_path, make, what):
    file = tmp_path / "gateway.toml"
    make(file)
    (problem,) = load(file).problems
    assert str(problem) == f"{file}: error: is {what}, not a file\n  help: name a file"


def test_a_file_that_this_user_may_not_read_can_be_given_to_everybody(tmp_path, monkeypatch):
    def refused(path, mode):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(Path, "open", refused)
    file = tmp_path / "gateway.toml"
    file.touch()
    said = [f"{file}: error: cannot be read: Permission denied\n  help: sudo chmod 644 {file}"]
    assert [str(one) for one in load(file).problems] == said


def test_a_file_in_another_encoding_is_one_problem(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_bytes('[[line]]\nname = "Förderband"\n'.encode("latin-1"))
    said = [f"{file}:2:1: error: this line is not UTF-8 text\n  help: save the file as UTF-8"]
    assert [str(one) for one in load(file).problems] == said


VALUES = st.sampled_from(
    """\
0 1 -1 248 8E1 true nan 1979-05-27 "" "auto" "0" "1ms" "1-99" "9-1" "8E1" "/dev/null" "tcp://[::1]:1" "rtu+tcp://x:1"
"mint" "all" "server" "ascii" [] {} [{}] [1,2] ["read"] {3=99} {x=1} [{unit="1-2",as=5}] [{unit=1},{unit=0}]
"/dev/\\u0000" "tcp://a..b:5020" {3=1,03=2} "40001-40100" [{at=0,values=[]}] [{unit=0,as=50}]
[{fc=3,items=1,time="1s"}] [{holding=2,every="1s"}] [{at=0,values=[1]}]""".split()  # noqa: SIM905 - as they stand in a file
)


@st.composite
def files(draw):
    """Files in which every key may have a value that is meant for another."""
    text, sections = "", dict(zip(keys_of(Config), Config.model_fields.values(), strict=True))
    for section in draw(st.lists(st.sampled_from(keys_of(Config)[2:]), max_size=5)):
        model = row_model(sections[section].annotation) or Table
        text += draw(st.sampled_from([f"[[{section}]]", f"[{section}]", f"[{section}.mint]"])) + "\n"
        for key in draw(st.lists(st.sampled_from(keys_of(model)), unique=True, max_size=6)):
            text += f"{key} = {draw(VALUES)}\n"
    return text


@given(files())
def test_whatever_a_file_says_it_can_be_used_or_the_errors_are_told(text):
    loaded = parse(text)
    assert (loaded.config is None) == any(problem.severity == "error" for problem in loaded.problems)
    if loaded.config is not None:
        resolve(loaded.config)


def test_what_a_wrong_table_refers_to_is_looked_at_together_with_what_is_wrong_in_it():
    assert problems(
        """\
        [[line]]
        port = "/dev/x"
        baud = "fast"
        profile = "mnt"
        devices = [{ unit = 1, timeout = 5 }, { unit = 1 }]
        """
    ) == [
        "gateway.toml:3:8: error: line[0].baud: must be a whole number",
        (
            'gateway.toml:4:11: error: line[0].profile: there is no profile "mnt"\n'
            '  help: did you mean "mint"? modbus-gateway profile list shows all'
        ),
        (
            "gateway.toml:5:34: error: line[0].devices[0].timeout: a duration needs a unit\n"
            '  help: put it in quotes with a unit: "5 ms" or "5 s"'
        ),
        (
            'gateway.toml:5:48: error: line[0].devices[1].unit: 1 is already a unit of line "x" (gateway.toml:5)\n'
            '  help: give one of them another unit ID for clients with "as"'
        ),
    ]


def test_a_row_that_is_no_table_has_no_name():
    assert problems("line = [5]") == ["gateway.toml:1:9: error: line[0]: must be a table"]


def test_a_file_that_is_none_of_ours_is_not_read_whole(tmp_path):
    file = tmp_path / "gateway.toml"
    start = "[[image]]\nunit = 1\nholding = 8\n"
    file.write_text(start.ljust(1024 * 1024, "#"))
    assert load(file).config is not None
    file.write_text(start.ljust(1024 * 1024 + 1, "#"))
    (said,) = load(file).problems
    assert str(said) == f"{file}: error: has more than 1048576 bytes\n  help: is it the right file?"


def test_so_many_problems_that_nobody_reads_them_are_counted_and_errors_come_first():
    lines = [f"x{number} = 1" for number in range(3000)]
    *listed, last = problems("\n".join(lines))
    assert len(listed) == 1000
    assert last == "gateway.toml: warning: 2000 more problems are not listed"
    tables = "".join(f'[[line]]\nname = "{number}"\nport = "/dev/a{number}"\nbaud = 17\n' for number in range(1200))
    assert any("more problems" in each for each in problems(tables))


@pytest.mark.parametrize(
    ("point", "remedy"),
    [
        ("register = 10", "a point has an area: holding = 10 (or input, coils, discrete), counted from 0"),
        ("address = 10", "a point has an area: holding = 10 (or input, coils, discrete), counted from 0"),
        ('holding = 10, type = "float"', 'did you mean "float32"?'),
        ('holding = 10, type = "real"', 'did you mean "float32"?'),
        ('holding = 10, write = "yes"', "true and false have no quotes"),
        ('holding = 10, type = "int32", swap = true', 'did you mean "words"?'),
        ('holding = 10, type = "int32", swap = "word"', 'did you mean "words"?'),
    ],
)
def test_what_others_call_things_of_a_point_is_understood(tmp_path, point, remedy):
    file = tmp_path / "gateway.toml"
    file.write_text(f'[[line]]\nport = "/dev/x"\ndevices = [{{ unit = 1, points = [{{ name = "a", {point} }}] }}]\n')
    assert remedy in {problem.remedy for problem in load(file).problems}


def test_a_rate_cannot_be_found_by_the_config(tmp_path):
    file = tmp_path / "gateway.toml"
    file.write_text('[[line]]\nport = "/dev/x"\nbaud = "auto"\n')
    remedy = "modbus-gateway scan --port PORT --all-speeds finds the rate of a line"
    assert remedy in {problem.remedy for problem in load(file).problems}


def test_a_problem_and_its_remedy_are_a_line_each_whatever_is_in_the_file():
    loaded = parse('"a\\nb" = 1\n[[line]]\nname = "c\\nd"\nport = "/dev/a"\nbaudd = 1\n', "gateway.toml")
    assert loaded.problems
    assert all(len(str(problem).splitlines()) == 1 + bool(problem.remedy) for problem in loaded.problems)
