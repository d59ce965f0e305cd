"""A text is checked as a file would be, without opening anything that it names, and it cannot hang the gateway."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gateway.config.reading.masking import MASK
from gateway.errors import ConfigError
from gateway.readconfig import process, text_check
from gateway.readconfig.text_check import TextChanges, check_text
from gateway.readconfig.text_reader import look_at
from kit.process import PATIENCE

IN_USE = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6 }]
"""
MIB = 1 << 20


@pytest.fixture
def file(tmp_path):
    return tmp_path / "gateway.toml"


def test_problems_have_their_place_and_say_what_to_write(file):
    (found,) = look_at(IN_USE.replace("unit = 6", 'unit = 6, mode = "rtu"'), IN_USE, file).problems
    assert (found.severity, found.line, found.column, found.path, found.file) == (
        "error", 5, 24, "line[0].devices[0].mode", ""
    )  # fmt: skip
    assert found.message.startswith("unknown key")
    assert found.help


def test_what_it_would_change_is_told_by_table_and_line_by_line(file):
    new = IN_USE.replace("unit = 6", "unit = 7") + '[[image]]\nunit = 9\nholding = 8\n[log]\nlevel = "debug"\n'
    found = look_at(new, IN_USE, file)
    assert found.changes == TextChanges(("image image-9",), (), ("line hall",), ("log",))
    assert "-devices = [{ unit = 6 }]" in found.difference
    assert "+devices = [{ unit = 7 }]" in found.difference


def test_a_text_that_is_in_use_changes_nothing(file):
    found = look_at(IN_USE, IN_USE, file)
    assert (found.problems, found.changes, found.difference) == ((), TextChanges(), ())


def test_it_says_what_was_not_looked_at(file):
    assert "not looked at: ports, addresses" in look_at(IN_USE, IN_USE, file).notes[0]


def test_a_process_of_its_own_finds_the_same(file):
    new = IN_USE.replace("6", "7")
    assert check_text(file, new, IN_USE) == look_at(new, IN_USE, file)


#: Each name in it is followed by `check` of a file.
NAMING = """
[[line]]
port = "{0}/port"
devices = [{{ unit = 1, profile = "..{0}/profile" }}, {{ unit = 2, profile = "danger" }}]
[[listen]]
bind = "tls://0.0.0.0:1802"
certificate = "{0}/zero"
key = "{0}/fifo"
clients_ca = "{0}/zero"
[web]
bind = "https://0.0.0.0:1803"
certificate = "{0}/zero"
key = "/dev/zero"
users = "{0}/fifo"
token = {{ file = "/dev/zero" }}
[mqtt]
broker = "mqtts://localhost"
ca = "/dev/zero"
password = {{ file = "{0}/fifo" }}
[fleet]
servers = ["tls://localhost"]
credentials = {{ file = "{0}/fifo" }}
[control]
socket = "{0}/socket"
"""
_WATCHED = """
import json, os, sys
touched = []
def note(event, arguments):
    if event in ("open", "import", "os.listdir", "os.scandir", "socket.bind", "socket.connect", "socket.getaddrinfo"):
        touched.append(f"{event} {arguments!r}")
from gateway.readconfig.text_reader import look_at
from pathlib import Path
text, file, named = sys.argv[1:]
for name in ("stat", "lstat", "readlink", "access"):
    def seen(path, *others, _name=name, _call=getattr(os, name), **more):
        touched.append(f"{_name} {path!r}")
        return _call(path, *others, **more)
    setattr(os, name, seen)
sys.addaudithook(note)
found = look_at(text, text, Path(file))
touched = [each for each in touched if named in each or "/dev/zero" in each or "danger" in each]
print(json.dumps([touched, [each.message for each in found.problems]]))
"""


@pytest.mark.parametrize("extra", ["", 'include = ["/dev/zero", "{0}/fifo"]\n', 'python = "danger:Clock"\n'])
def test_nothing_that_it_names_is_opened_or_looked_for(file, tmp_path, extra):
    named = tmp_path / "named"
    named.mkdir()
    os.mkfifo(named / "fifo")
    (named / "zero").symlink_to("/dev/zero")
    (tmp_path / "danger.py").write_text("raise SystemExit('imported')")
    text = (extra + NAMING).format(named)
    words = [sys.executable, "-c", _WATCHED, text, str(file), str(named)]
    path = os.pathsep.join([str(Path.cwd()), str(tmp_path)])
    ended = subprocess.run(
        words, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, timeout=60, check=True
    )
    touched, messages = json.loads(ended.stdout)
    assert all("danger.toml" in each for each in touched), touched  # own profiles are where the config has them
    assert any('no profile "danger"' in each for each in messages)
    assert ("unknown key" in messages) == ("python" in extra)


def test_own_profiles_are_those_of_the_gateway(file, tmp_path):
    profiles = tmp_path / "profiles"
    profiles.mkdir()
    (profiles / "meter.toml").write_text("[profile.meter]\nmargin = 0\n")
    text = IN_USE.replace("unit = 6", 'unit = 6, profile = "meter"')
    (found,) = look_at(text, IN_USE, file).problems
    assert (found.file, found.line) == (str(profiles / "meter.toml"), 2)
    (profiles / "meter.toml").write_text("[profile.meter]\nmargin = 2\n")
    found = look_at(text, IN_USE, file)
    assert found.problems == ()
    assert any("own profiles are those of the gateway: meter" in each for each in found.notes)


@pytest.mark.parametrize(
    "line",
    [
        f'[mqtt]\nbroker = "mqtt://{MASK}@broker"',
        f'[mqtt]\nbroker = "mqtt://broker"\npassword = "{MASK}"',
        f'[web]\nbind = "http://127.0.0.1:80"\ntoken = "{MASK}"',
        f'[[access]]\nfrom = ["{MASK}"]',
        f'[profile.x]\npasword = {{ deep = ["{MASK}"] }}',
    ],
)
def test_a_mask_is_an_error_so_that_it_is_not_applied(file, line):
    found = look_at(f"{IN_USE}{line}\n", IN_USE, file)
    said = [each for each in found.problems if "this is the mask" in each.message]
    assert [each.severity for each in said] == ["error"]
    assert said[0].line == line.count("\n") + 6


@pytest.mark.parametrize(
    "secret",
    [
        '[mqtt]\nbroker = "mqtt://anna:hunter2@broker"',
        '[mqtt]\nbroker = "mqtt://broker"\npassword = """\nhunter2"""',
        "[mqtt]\nbroker = 'mqtt://broker'\npasswort = '''hunter2'''",
        '# password = "hunter2"',
        'site = "plant" # hunter2',
        '[web]\nbind = "http://127.0.0.1:80"\n"to\\u006ben" = "hunter2"',
        '[[line]]\nport = "/dev/x"\nkey = "-----BEGIN PRIVATE KEY-----hunter2"',
        '[profile.x]\npassword = ["a", { b = "hunter2" }]',
    ],
)
def test_no_secret_of_the_config_in_use_is_told(file, secret):
    in_use = f"{secret}\n{IN_USE}" if "site" in secret else f"{IN_USE}{secret}\n"
    assert "hunter2" not in str(look_at(IN_USE, in_use, file))
    assert "hunter2" not in "".join(look_at(in_use, IN_USE, file).difference)


def test_a_text_of_one_mebibyte_is_checked_and_a_larger_one_is_not(file):
    text = IN_USE + "#" * (MIB - len(IN_USE))
    assert check_text(file, text, IN_USE).problems == ()
    (found,) = check_text(file, text + "#", IN_USE).problems
    assert (found.severity, found.message) == ("error", f"has more than {MIB} bytes")


def test_text_that_is_none_is_a_problem(file):
    (found,) = check_text(file, 'site = "\ud800"', IN_USE).problems
    assert found.message == "is not UTF-8 text"


def test_line_ends_of_windows_are_none_of_the_difference(file):
    assert check_text(file, "\ufeff" + IN_USE.replace("\n", "\r\n"), IN_USE).difference == ()


@pytest.mark.parametrize("text", ["a = " + "[" * 500_000, "a = " + "[" * 900 + "]" * 900, "a." * 5000 + "a = 1"])
def test_deep_nesting_is_a_problem(file, text):
    assert look_at(text, IN_USE, file).has_errors


def test_what_a_problem_quotes_is_short(file):
    text = f'[[line]]\nname = "{"x" * 500_000}"\n' + "".join(f"k{number} = 1\n" for number in range(2000))
    found = look_at(text, IN_USE, file)
    assert len(found.problems) == 1001
    assert len(str(found)) < 2_000_000


def test_a_text_that_takes_too_long_is_given_up(file, monkeypatch):
    monkeypatch.setattr(text_check, "CHECKING_TIME", 0.5)
    begun = time.monotonic()
    with pytest.raises(ConfigError, match=r"the text: cannot be read within 0.5 s"):
        check_text(file, '[[line]]\nport = "/dev/x"\n' * 30_000, IN_USE)
    assert time.monotonic() - begun < PATIENCE / 2


def test_a_text_that_takes_too_much_memory_is_given_up(file, monkeypatch):
    small = "gateway.readconfig.text_reader.MOST_MEMORY = 60 << 20; main()"
    monkeypatch.setattr(
        process, "_PROGRAM", process._PROGRAM.replace("main()", f"import gateway.readconfig.text_reader\n{small}")
    )
    text = "".join(f'[[line]]\nname = "a{each}"\nport = "/dev/x{each}"\n' for each in range(4_000))
    with pytest.raises(ConfigError, match=r"it needs more than 60 MiB of memory|SIGABRT; is memory short\?"):
        check_text(file, text, IN_USE)


def test_a_process_that_checks_gives_way_to_all_others():
    watch = (
        "import os\nfrom pathlib import Path\nfrom gateway.readconfig.text_reader import check_given_text\n"
        "check_given_text(Path('/x/gateway.toml'), b'0\\n')\nprint(os.nice(0))"
    )
    ended = subprocess.run([sys.executable, "-c", watch], capture_output=True, text=True, timeout=60, check=True)
    assert int(ended.stdout) == min(os.nice(0) + 10, 19)


def test_paths_count_from_the_folder_of_the_config():
    assert look_at(IN_USE, IN_USE, Path("/etc/modbus-gateway/config.toml")).problems == ()


def test_include_is_not_followed_and_a_note_says_so(file):
    text = f'include = ["conf.d/*.toml", "/none.toml"]\n{IN_USE}'
    in_use = f"{text}#:include conf.d/b.toml\n[[image]]\nunit = 9\nholding = 8\n"
    found = look_at(text, in_use, file)
    assert "include is not followed: conf.d/*.toml, /none.toml" in found.notes
    assert (found.problems, found.changes, found.difference) == ((), TextChanges(), ())


def test_a_text_with_its_included_files_is_compared_with_all_that_is_in_use(file):
    in_use = f'include = ["b.toml"]\n{IN_USE}#:include b.toml\n[[image]]\nunit = 9\nholding = 8\n'
    found = look_at(in_use + "[[image]]\nunit = 10\nholding = 8\n", in_use, file)
    assert found.changes == TextChanges(("image image-10",))
    assert not any("include" in note for note in found.notes)
