"""The config files that come with the program: each says what it is for, and can be used as it stands."""

from pathlib import Path

import pytest

from gateway.config.load import parse

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
FIRST = DEPLOY / "gateway.toml"
EXAMPLES = sorted(DEPLOY.glob("examples/*.toml"))


def errors(text: str) -> list[str]:
    """What `check` would refuse."""
    return [str(one) for one in parse(text, "gateway.toml").problems if one.severity == "error"]


def test_there_are_examples():
    assert len(EXAMPLES) > 5


@pytest.mark.parametrize("file", [FIRST, *EXAMPLES], ids=lambda file: file.stem)
def test_it_can_be_used_as_it_stands(file: Path):
    assert errors(file.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("file", [FIRST, *EXAMPLES], ids=lambda file: file.stem)
def test_the_service_can_use_it(file: Path):
    """The socket unit opens one address, and the service does not start unless a listener takes it."""
    config = parse(file.read_text(encoding="utf-8")).config
    assert config is not None
    assert [str(listen.bind) for listen in config.listen] == ["tcp://[::]:502"]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_it_says_in_two_lines_what_it_is_for(file: Path):
    first, second, third, *_ = file.read_text(encoding="utf-8").splitlines()
    assert first.startswith("# ")
    assert second.startswith("# ")
    assert third == ""


def test_the_line_in_the_first_config_can_be_used_once_its_marks_are_taken_away():
    text = FIRST.read_text(encoding="utf-8")
    marked = "\n#[[line]]\n"
    assert marked in text
    head, rest = text.split(marked)
    line, _, tail = rest.partition("\n\n")
    unmarked = "\n".join(each.removeprefix("#") for each in line.splitlines())
    assert errors(f"{head}\n[[line]]\n{unmarked}\n\n{tail}") == []
