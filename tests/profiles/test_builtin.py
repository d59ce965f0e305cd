"""The shipped profiles say what the manufacturers' documents say."""

import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest

import gateway.profiles
from gateway.profiles import is_file_name, shipped_names, shipped_text


def profile(name: str) -> dict:
    (table,) = tomllib.loads(shipped_text(name))["profile"].values()
    return table


@pytest.mark.parametrize("name", shipped_names())
def test_each_file_holds_the_one_profile_of_its_name(name):
    assert list(tomllib.loads(shipped_text(name))) == ["profile"]
    assert list(tomllib.loads(shipped_text(name))["profile"]) == [name]
    assert profile(name)["title"]


@pytest.mark.parametrize(
    "name", ["mnt", "", "../profiles/mint", "/etc/passwd", "mint/", ".mint", "a\0b", "__init__.py"]
)
def test_there_are_no_others(name):
    assert shipped_text(name) is None


@pytest.mark.parametrize(
    ("name", "is_one"), [("eastron-sdm630", True), ("Zähler_1.2", True), ("a/b", False), ("..", False), ("", False)]
)
def test_names_that_files_can_have(name, is_one):
    assert is_file_name(name) == is_one


def test_they_are_read_out_of_an_archive_too(tmp_path):
    """As in a zipapp."""
    package = Path(gateway.profiles.__file__).parents[1]
    with ZipFile(tmp_path / "gateway.zip", "w") as archive:
        for file in (*package.glob("*.py"), *package.joinpath("profiles").glob("*.*")):
            archive.write(file, file.relative_to(package.parent))
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); from gateway import profiles as p;"
        "print(p.__file__, p.shipped_names(), p.shipped_text('mint'))"
    )
    words = [sys.executable, "-I", "-c", program, str(tmp_path / "gateway.zip")]
    shown = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    assert shown == f"{tmp_path}/gateway.zip/gateway/profiles/__init__.py {shipped_names()} {shipped_text('mint')}\n"


def test_generic_knows_no_rule():
    assert set(profile("generic")) == {"title", "timeout"}


def test_mint_has_the_functions_and_registers_of_its_application_note():
    mint = profile("mint")
    assert mint["functions"] == [1, 2, 3, 5, 16, 23]
    assert mint["holding"] == "1-99"
    assert mint["limits"] == {"3": 99}


def test_mint_has_the_answer_times_of_its_application_note():
    points = [(point["fc"], point["items"], point["time"]) for point in profile("mint")["timing"]]
    assert points == [
        (1, 1, "10 ms"),
        (1, 16, "10 ms"),
        (2, 1, "10 ms"),
        (2, 16, "10 ms"),
        (3, 1, "10 ms"),
        (3, 99, "420 ms"),
        (5, 1, "10 ms"),
        (16, 1, "10 ms"),
        (16, 99, "240 ms"),
        (23, 1, "14 ms"),
        (23, 99, "500 ms"),
    ]


def test_v80_has_its_own_limits_and_silence():
    v80 = profile("v80")
    assert v80["functions"] == [1, 2, 3, 4, 5, 6, 15, 16]
    assert v80["limits"] == {"1": 1024, "3": 125}
    assert v80["idle_chars"] == 4.5


def test_the_weigher_reads_and_writes_registers_only():
    assert profile("weigher")["functions"] == [3, 16]
