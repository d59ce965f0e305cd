"""Profiles out of files: which one is meant, and what is wrong with it."""

from textwrap import dedent

import pytest

from gateway.config.load import load, load_profile, parse
from gateway.config.machine.profile_folders import folders_of, names_in
from gateway.config.profile_files import ProfileFiles
from gateway.profiles import shipped_names

LINE = '[[line]]\nname = "hall"\nport = "/dev/null"\ndevices = [{{ unit = 1, profile = "{}" }}]\n'


@pytest.fixture
def files(tmp_path):
    """Profiles beside a config and those of the machine, in this order."""
    return ProfileFiles((tmp_path / "beside", tmp_path / "etc"))


@pytest.fixture
def write(tmp_path):
    """Writes the file of a profile: folder, name, keys."""

    def write(folder, name, text=None):
        file = tmp_path / folder / f"{name}.toml"
        file.parent.mkdir(exist_ok=True)
        file.write_text(f'[profile.{name}]\ntitle = "{folder}"\n' if text is None else dedent(text), encoding="utf-8")
        return file

    return write


def parsed(text, files):
    return parse(text, port_trouble=lambda _: None, profile_files=files)


def test_the_nearest_profile_is_the_one_that_is_meant(files, write):
    text = LINE.format("v80")
    assert parsed(text, ProfileFiles(files._folders)).config.profile["v80"].place == "shipped"
    etc = write("etc", "v80")
    config = parsed(text, ProfileFiles(files._folders)).config
    assert (config.profile["v80"].title, config.profile["v80"].place) == ("etc", f"{etc}:1")
    write("beside", "v80")
    assert parsed(text, ProfileFiles(files._folders)).config.profile["v80"].title == "beside"
    own = f'{text}[profile.v80]\ntitle = "own"\n'
    assert parsed(own, ProfileFiles(files._folders)).config.profile["v80"].title == "own"


def test_what_is_hidden_is_told(files, write):
    etc, beside = write("etc", "v80"), write("beside", "v80")
    loaded = parsed(LINE.format("v80"), files)
    (origin,) = loaded.profiles
    assert origin.hides == (str(etc), "shipped")
    assert str(origin) == f"{beside}:1, hides {etc} and the shipped one"
    (problem,) = loaded.problems
    assert str(problem) == (
        f"{beside}:1:1: warning: profile.v80: hides {etc}\n  help: remove one of them, or give one another name"
    )


def test_a_table_of_the_config_hides_files(files, write):
    beside = write("beside", "v80")
    loaded = parsed(LINE.format("v80") + "[profile.v80]\n", files)
    assert [str(each).partition("\n")[0] for each in loaded.problems] == [
        f"gateway.toml:5:1: warning: profile.v80: hides {beside}"
    ]


def test_a_shipped_profile_may_be_hidden_without_a_warning(files, write):
    write("etc", "v80")
    loaded = parsed(LINE.format("v80"), files)
    assert (loaded.problems, loaded.profiles[0].hides) == ((), ("shipped",))


def test_only_the_files_of_profiles_in_use_are_read(files, write):
    write("etc", "broken", "[profile.broken")
    assert parsed(LINE.format("v80"), files).problems == ()
    assert set(files.found) == {"generic", "v80"}  # generic is the profile of the line


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[profile.meter\n", "1:1: error: brackets are missing"),
        ("[profile.meter]\nfunction = [3]\n", "2:1: error: profile.meter.function: unknown key\n  help: did you mean"),
        ("[profile.meter]\nmargin = 0\n", "2:10: error: profile.meter.margin: must be at least 1"),
        (
            '[profile.meter]\npoints = [\n  { name = "a", holding = 1, scale = 0 },\n]\n',
            "3:38: error: profile.meter.points[0].scale: must not be 0",
        ),
        ("title = 'x'\n", "1:1: error: has no profile\n  help: write [profile.meter] above the keys of this kind"),
        ("profile = 3\n", "1:1: error: has no profile"),
        (
            "[profile.meter]\n[profile.other]\n",
            "2:1: error: profile.other: is a second profile, beside [profile.meter]\n  help: move it to other.toml",
        ),
        (
            "[profile.other]\n",
            '1:1: error: profile.other: the file is meter.toml, and its profile is "other"\n  help: rename it',
        ),
        (
            "[profile.meter]\n[[line]]\n",
            "2:1: error: line: a file of a profile has nothing but [profile.NAME]\n  help: write it into the config",
        ),
        ("[profile.meter]\nx = " + "[" * 10_000, "1:1: error: is nested too deeply"),
        ("[profile.meter]\nx = " + "9" * 5000, "error: Exceeds the limit"),
    ],
)
def test_a_broken_file_that_is_in_use_is_an_error_there(files, write, text, said):
    file = write("etc", "meter", text)
    loaded = parsed(LINE.format("meter"), files)
    assert loaded.config is None
    (problem,) = loaded.problems
    assert str(problem).startswith(str(file))
    assert said in str(problem)


def test_a_file_that_cannot_be_read_is_an_error(files, tmp_path):
    there = tmp_path / "etc" / "meter.toml"
    there.mkdir(parents=True)
    assert parsed(LINE.format("meter"), files).errors == (
        f"{there}: error: is a directory, not a file\n  help: name a file",
    )
    there.rmdir()
    there.symlink_to("nowhere")
    said = f"{there}: error: there is no such file\n  help: create it, or name another file"
    assert parsed(LINE.format("meter"), ProfileFiles((there.parent,))).errors == (said,)
    there.unlink()
    there.write_bytes(b"[profile.meter]\ntitle = '\xff'\n")
    said = f"{there}:2:1: error: this line is not UTF-8 text\n  help: save the file as UTF-8"
    assert parsed(LINE.format("meter"), ProfileFiles((there.parent,))).errors == (said,)


def test_a_broken_file_is_told_once_and_hides_no_other_problem(files, write):
    write("etc", "meter", "[profile.meter]\nmargin = 0\n")
    text = LINE.format("meter") + '[[line]]\nport = "/dev/null2"\nprofile = "meter"\ndevices = [{ unit = 1 }]\n'
    said = [one.what for one in parsed(text, files).problems]
    assert said[-1] == "must be at least 1"
    assert any("unit 1" in each or "already" in each for each in said[:-1])


def test_a_problem_of_a_profile_beside_others_is_found_in_its_file(files, write):
    """What the profile of a device forbids its own points is a matter of the config."""
    write("etc", "meter", '[profile.meter]\n\nfunctions = [4]\npoints = [{ name = "a", holding = 1 }]\n')
    loaded = parsed(LINE.format("meter"), files)
    (said,) = loaded.errors
    assert said.startswith(
        f"{files._folders[1]}/meter.toml:4:35: error: profile.meter.points[0].holding: cannot be read"
    )


def test_what_is_wrong_in_a_file_comes_behind_what_is_wrong_in_the_config(files, write):
    file = write("etc", "meter", "[profile.meter]\nmargin = 0\n")
    loaded = parsed("\n\n" + LINE.format("meter") + "[log]\nspeed = 1\n", files)
    assert [one.file for one in loaded.problems][-1] == str(file)
    assert {one.file for one in loaded.problems[:-1]} == {"gateway.toml"}


@pytest.mark.parametrize(
    ("name", "advice"),
    [
        ("wiegher", 'did you mean "weigher"? modbus-gateway profile list shows all'),
        ("eigher", 'did you mean "weigher"? modbus-gateway profile list shows all'),
        ("Mint", 'did you mean "mint"? modbus-gateway profile list shows all'),
        ("zzz", "modbus-gateway profile list shows all"),
        ("../mint", 'did you mean "mint"? modbus-gateway profile list shows all'),
    ],
)
def test_an_unknown_profile(files, name, advice):
    (problem,) = parsed(LINE.format(name), files).problems
    assert (problem.line, problem.column, problem.what) == (4, 34, f'there is no profile "{name}"')
    assert problem.remedy == advice


def test_a_profile_in_a_file_with_another_name(files, write):
    file = write("etc", "em24", "[profile.em340]\n")
    (problem,) = parsed(LINE.format("em340"), files).problems
    assert problem.remedy == f"it is in {file}, which must be called em340.toml"


def test_a_name_that_only_a_config_can_have(files):
    assert parsed(LINE.format("a/b") + '[profile."a/b"]\n', files).problems == ()


def test_a_folder_that_cannot_be_looked_into_is_a_warning(tmp_path):
    """With the name of this folder the system refuses, as for a folder of root."""
    folder = tmp_path / ("x" * 300)
    loaded = parsed(LINE.format("v80"), ProfileFiles((folder,)))
    (problem,) = loaded.problems
    assert loaded.config is not None
    assert str(problem).startswith(f"{folder}: warning: profiles in it are not known: File name too long\n  help: ")
    files = ProfileFiles((folder,))
    assert files.names() == shipped_names()
    assert list(files.problems) == [folder]


def test_the_folders_of_a_config(tmp_path):
    own = tmp_path / "etc" / "profiles"
    own.parent.mkdir()
    assert folders_of(tmp_path / "gateway.toml", own) == (tmp_path / "profiles", own)
    assert folders_of(own.parent / "gateway.toml", own) == (own,)
    (tmp_path / "link").symlink_to("etc")
    assert folders_of(tmp_path / "link" / "gateway.toml", own) == (own,)


def test_the_names_in_a_folder(tmp_path):
    for name in ("b.toml", "a.toml", "notes.txt", ".hidden.toml", "a b.toml"):
        (tmp_path / name).touch()
    assert names_in(tmp_path) == ["a", "b"]
    assert names_in(tmp_path / "nowhere") == []
    assert names_in(tmp_path / "a.toml") == []


def test_a_file_finds_profiles_beside_it(write, tmp_path):
    write("profiles", "meter")
    config = tmp_path / "gateway.toml"
    config.write_text(LINE.format("meter"))
    assert load(config).config.profile["meter"].place == f"{tmp_path}/profiles/meter.toml:1"


@pytest.mark.parametrize("name", shipped_names())
def test_a_shipped_profile_is_valid(name, files):
    loaded = parsed(f'[[image]]\nunit = 1\nholding = 1\nprofile = "{name}"\n', files)
    assert loaded.problems == ()


def test_a_file_by_itself_is_checked_as_in_a_config(write):
    """Its name may be any, unless it is asked for."""
    file = write("etc", "draft", '[profile.meter]\npoints = [{ name = "a", holding = 1, scale = 0 }]\n')
    checked = load_profile(file)
    assert (checked.name, [str(each) for each in checked.problems]) == (
        "meter",
        [f"{file}:2:46: error: profile.meter.points[0].scale: must not be 0"],
    )
    assert "rename it to meter.toml" in str(load_profile(file, "draft").problems)
    assert "there is no such file" in str(load_profile(file.with_name("none.toml")).problems)
    assert load_profile(write("etc", "good")).problems == ()
