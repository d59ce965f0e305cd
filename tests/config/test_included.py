"""A config in several files: what is read, what is wrong, and which file is named."""

from pathlib import Path
from textwrap import dedent

import pytest

from gateway.config.included import MOST_FILES
from gateway.config.load import load
from gateway.config.machine.file_text import MOST_BYTES
from gateway.config.machine.included import files_of, written_in
from gateway.config.reading.masking import MASK, masked
from gateway.config.reading.whole_text import joined, parted

MAIN = 'include = ["conf.d/*.toml"]\n[[line]]\nname = "a"\nport = "/dev/ttyA"\ndevices = [{ unit = 1, name = "one" }]\n'
OTHER = '[[line]]\nname = "b"\nport = "/dev/ttyB"\ndevices = [{ unit = 2, name = "two" }]\n'


@pytest.fixture
def written(tmp_path, monkeypatch):
    """Write files into a folder, and load its gateway.toml from there."""
    monkeypatch.chdir(tmp_path)

    def write(files, *, main="gateway.toml"):
        for name, text in {"gateway.toml": MAIN, **files}.items():
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_text(dedent(text))
        return load(main, port_trouble=lambda _: None, real_path=str)

    return write


def problems(loaded):
    return [str(each) for each in loaded.problems]


def test_files_are_read_behind_the_config_in_the_order_of_the_list_then_of_names(written):
    loaded = written(
        {
            "gateway.toml": 'include = ["z.toml", "conf.d/*.toml"]\n' + MAIN.partition("\n")[2],
            "z.toml": OTHER.replace('"b"', '"z"').replace("ttyB", "ttyZ").replace("2", "4").replace("two", "four"),
            "conf.d/20-c.toml": OTHER.replace('"b"', '"c"')
            .replace("ttyB", "ttyC")
            .replace("2", "3")
            .replace("two", "x"),
            "conf.d/10-b.toml": "# a comment\n\n" + OTHER,
        }
    )
    assert problems(loaded) == []
    assert [(line.name, line.place) for line in loaded.config.line] == [
        ("a", "gateway.toml:2"),
        ("z", "z.toml:1"),
        ("b", "conf.d/10-b.toml:3"),
        ("c", "conf.d/20-c.toml:1"),
    ]
    assert [line.devices[0].place for line in loaded.config.line[1:3]] == ["z.toml:4", "conf.d/10-b.toml:6"]


def test_without_the_key_a_config_has_no_parts(written):
    loaded = written({"gateway.toml": OTHER, "conf.d/b.toml": "not TOML"})
    assert problems(loaded) == []
    assert loaded.text == OTHER
    assert loaded.positions.parts == ()


@pytest.mark.parametrize(
    "name", ["conf.d/.b.toml", "conf.d/b.toml~", "conf.d/#b.toml#", "conf.d/b.toml/x", "conf.d/b.txt"]
)
def test_what_matches_no_pattern(written, name):
    loaded = written({name: "not TOML"})
    assert problems(loaded) == ["gateway.toml:1:12: warning: include[0]: no file matches at the moment"]
    assert len(loaded.config.line) == 1


def test_a_pattern_that_means_the_config_too_leaves_it_out_and_each_file_is_read_once(written):
    assert (
        problems(written({"gateway.toml": MAIN.replace("conf.d/", "").replace("]", ', "b.toml"]', 1), "b.toml": OTHER}))
        == []
    )


def test_a_link_to_a_file_is_a_file(written, tmp_path):
    Path("conf.d").mkdir()
    Path("conf.d/b.toml").symlink_to("../elsewhere")
    assert len(written({"elsewhere": OTHER}).config.line) == 2


def test_paths_count_from_the_folder_of_the_file_they_stand_in(written, tmp_path):
    web = (
        '[web]\nbind = "http://127.0.0.1:0"\nusers = "users"\n[[line]]\nport = "pty:b"\nrole = "server"\nserves = [1]\n'
    )
    loaded = written({"conf.d/web.toml": web, "conf.d/c.toml": '[control]\nsocket = "c.sock"\n'})
    assert loaded.plan.web.users == str(tmp_path / "conf.d/users")
    assert loaded.plan.control == str(tmp_path / "conf.d/c.sock")
    assert written_in(Path("gateway.toml"), "control", "socket") == ("c.sock", Path("conf.d/c.toml"))


def test_own_profiles_may_be_in_any_file(written):
    loaded = written(
        {
            "conf.d/p.toml": '[profile.pump]\nholding = "0-9"\n',
            "conf.d/b.toml": OTHER.replace("[{", '[{ profile = "pump",'),
        }
    )
    assert problems(loaded) == []


ONCE = "  help: there is one in all files together"

BAD = {
    "a value": (
        {"conf.d/b.toml": OTHER.replace('"/dev/ttyB"', "5")},
        ['conf.d/b.toml:3:8: error: line[0].port: must be text (line "b")\n  help: put it in quotes: "5"'],
    ),
    "an unknown key": (
        {"conf.d/b.toml": f"{OTHER}[[lisen]]\n"},
        ['conf.d/b.toml:5:1: error: lisen: unknown key\n  help: did you mean "listen"?'],
    ),
    "text that is no TOML, in two files": (
        {"conf.d/b.toml": f"{OTHER}x = [1,\n", "conf.d/c.toml": '[web]\nbind = "\n'},
        [
            "conf.d/b.toml:5:5: error: the list that begins here has no ] at its end",
            (
                "conf.d/c.toml:2:9: error: the text has no closing quote\n"
                "  help: put the quote that it begins with at its end too"
            ),
        ],
    ),
    "a name that is there": (
        {"conf.d/b.toml": OTHER.replace('"b"', '"a"')},
        ['conf.d/b.toml:2:8: error: line[0].name: "a" is already used in gateway.toml:2 (line "a")'],
    ),
    "the name of a device of an included file": (
        {
            "conf.d/b.toml": OTHER,
            "conf.d/c.toml": OTHER.replace('"b"', '"c"').replace("ttyB", "ttyC").replace("2", "3"),
        },
        [
            (
                "conf.d/c.toml:4:31: error: line[0].devices[0].name: "
                '"two" is already used in conf.d/b.toml:4, devices[0] (line "c")'
            ),
        ],
    ),
    "a unit": (
        {"conf.d/b.toml": OTHER.replace("2", "1")},
        [
            (
                'conf.d/b.toml:4:21: error: line[0].devices[0].unit: 1 is already a unit of line "a" (gateway.toml:5) '
                '(line "b")\n  help: give one of them another unit ID for clients with "as", or as = "none" and the '
                'line a listener of its own: [[listen]] with line = "b"'
            ),
        ],
    ),
    "a single table in two files": (
        {"gateway.toml": f"{MAIN}[trace]\n", "conf.d/b.toml": f"{OTHER}\n[trace]\nring = '0'\n"},
        ["conf.d/b.toml:6:1: error: trace: is already in gateway.toml:6\n" + ONCE],
    ),
    "a profile in two included files": (
        {"conf.d/b.toml": "[profile.x]\n", "conf.d/c.toml": "# x\n[profile.y]\n[profile.x]\n"},
        [
            ("conf.d/c.toml:3:1: error: profile.x: is already in conf.d/b.toml:1\n" + ONCE),
        ],
    ),
    "include in an included file": (
        {"conf.d/b.toml": f'include = ["x.toml"]\n{OTHER}'},
        ["conf.d/b.toml:1:1: error: include: an included file includes no others\n  help: name them in gateway.toml"],
    ),
    "keys above the first table": (
        {"conf.d/b.toml": f'site = "x"\nweb.bind = "y"\nlisten = []\n{OTHER}'},
        [
            (
                "conf.d/b.toml:1:1: error: site: an included file has tables only, each below a heading\n"
                "  help: write it at the top of gateway.toml"
            ),
            (
                "conf.d/b.toml:2:1: error: web: an included file has tables only, each below a heading\n"
                "  help: write [web]"
            ),
            (
                "conf.d/b.toml:3:1: error: listen: an included file has tables only, each below a heading\n"
                "  help: write [[listen]]"
            ),
        ],
    ),
    "one bracket": (
        {"conf.d/b.toml": '[line]\nname = "b"\n'},
        ["conf.d/b.toml:1:1: error: line: is a list of tables\n  help: write [[line]] with two brackets"],
    ),
    "rows of a table of another file": (
        {"conf.d/b.toml": "[[line.devices]]\nunit = 5\n"},
        ["conf.d/b.toml:1:1: error: line: is a list of tables\n  help: write [[line]] with two brackets"],
    ),
    "a list in one line": (
        {"gateway.toml": MAIN.replace("\n", "\nlisten = []\n", 1), "conf.d/b.toml": '[[listen]]\nbind = "tcp://:1"\n'},
        [
            (
                "conf.d/b.toml:1:1: error: listen: is written as listen = [...] in gateway.toml:2\n"
                "  help: write [[listen]] there"
            ),
        ],
    ),
    "a named file that is missing": (
        {"gateway.toml": MAIN.replace("*", "b")},
        [
            (
                "gateway.toml:1:12: error: include[0]: conf.d/b.toml: there is no such file\n"
                "  help: create it, or name another file"
            ),
        ],
    ),
    "itself": (
        {"gateway.toml": MAIN.replace("conf.d/*", "gateway")},
        ["gateway.toml:1:12: error: include[0]: is this file itself\n  help: take it out"],
    ),
    "wildcards in a folder": (
        {"gateway.toml": MAIN.replace("conf.d", "**")},
        [
            (
                "gateway.toml:1:12: error: include[0]: has a wildcard in the name of a folder\n"
                '  help: name each folder: ["east/*.toml", "west/*.toml"]'
            ),
        ],
    ),
    "text in place of a list": (
        {"gateway.toml": MAIN.replace("[", "", 1).replace("]", "", 1)},
        ['gateway.toml:1:11: error: include: must be a list of files\n  help: write ["conf.d/*.toml"]'],
    ),
    "below a table": (
        {"gateway.toml": f'{MAIN.partition(chr(10))[2]}include = ["conf.d/*.toml"]\n'},
        [
            (
                'gateway.toml:5:1: error: line[0].include: unknown key (line "a")\n'
                "  help: include stands at the top of the file, before the first [table]"
            ),
        ],
    ),
    "too large together": (
        {"conf.d/b.toml": f"[trace]\n#{'x' * (MOST_BYTES - 100)}\n"},
        [
            ("gateway.toml:1:11: error: include: with the files that it names, the config has more than 1048576 bytes"),
        ],
    ),
    "not UTF-8": (
        {"conf.d/b.toml": "[trace]\n# \udcff\n"},
        ["conf.d/b.toml:2:1: error: this line is not UTF-8 text\n  help: save the file as UTF-8"],
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_wrong_is_said_with_the_file_that_it_is_in(written, case, monkeypatch):
    files, said = BAD[case]
    monkeypatch.setattr(Path, "write_text", lambda file, text: file.write_bytes(text.encode(errors="surrogateescape")))
    loaded = written(files)
    assert problems(loaded) == said
    assert loaded.config is None


def test_too_many_files(written):
    loaded = written({f"conf.d/{number}.toml": "" for number in range(MOST_FILES + 1)})
    assert problems(loaded) == ["gateway.toml:1:11: error: include: means 201 files; 200 are possible"]


def test_files_are_named_as_the_config_is(written, tmp_path):
    (wrong,) = written({"conf.d/b.toml": "[[line]]\n"}, main=str(tmp_path / "gateway.toml")).errors
    assert wrong.startswith(f"{tmp_path}/conf.d/b.toml:1:1: error: line[0].port: port is missing")


def test_the_text_has_all_files_and_can_be_taken_apart(written):
    loaded = written({"conf.d/b.toml": f"# secret\n{OTHER.rstrip()}", "conf.d/c.toml": ""})
    assert parted(loaded.text) == (MAIN, {"conf.d/b.toml": f"# secret\n{OTHER}", "conf.d/c.toml": ""})
    assert joined(*parted(loaded.text)) == loaded.text
    assert masked(loaded.text) == f"{MAIN}#:include conf.d/b.toml\n{OTHER}#:include conf.d/c.toml\n"


def test_masks_and_secrets_of_all_files(written):
    web = f'[mqtt]\nbroker = "mqtt://h"\npassword = "{MASK}"\n'
    errors = written({"conf.d/m.toml": web}).errors
    assert any(each.startswith("conf.d/m.toml:3:12: error: mqtt.password: this is the mask") for each in errors)


def test_the_files_of_a_config_are_found_whatever_is_wrong_with_them(written):
    written({"conf.d/b.toml": "not TOML", "conf.d/c.toml": '[web]\nbind = "x"\n'})
    main = Path("gateway.toml")
    assert files_of(main) == [main, Path("conf.d/b.toml"), Path("conf.d/c.toml")]
    assert written_in(main, "web", "bind") == ("x", Path("conf.d/c.toml"))
    assert written_in(main, "web", "users") == ("", main)
    main.write_text("include = 5")
    assert files_of(main) == [main]
    assert files_of(Path("none.toml")) == [Path("none.toml")]


def test_a_comment_that_looks_like_the_line_between_files_is_none(written):
    loaded = written({"gateway.toml": f"#:include x\n{MAIN}", "conf.d/b.toml": f"{OTHER}#:include ../y\n"})
    assert parted(loaded.text) == (f"# include x\n{MAIN}", {"conf.d/b.toml": f"{OTHER}# include ../y\n"})
    assert loaded.errors == ()


def test_nor_is_one_in_a_last_line_without_an_end(written):
    loaded = written({"conf.d/b.toml": f"{OTHER}#:include ../y"})
    assert parted(loaded.text) == (MAIN, {"conf.d/b.toml": f"{OTHER}# include ../y\n"})


def test_a_note_about_a_pattern_stands_in_the_order_of_the_file(written):
    loaded = written({"gateway.toml": f'site = "x"\n{MAIN}', "b.toml": OTHER})
    assert [each.line for each in loaded.problems] == [1, 2]
