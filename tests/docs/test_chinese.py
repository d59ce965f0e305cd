"""Commands and configs of the Chinese pages are those of the English ones."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("zh/*.md"))
#: Chinese pages that are the whole of an English one: they have all of its blocks, in its order.
WHOLE = {"first-values": "tutorials/first-values.md", "bridge": "tutorials/bridge.md", "addressing": "addressing.md"}
_FENCED = re.compile(r"^```\w+\n.*?^```$", re.MULTILINE | re.DOTALL)
_INDENTED = re.compile(r"^ {4}\S.*$", re.MULTILINE)
_COMMAND = re.compile(r"`((?:sudo |\./deploy/|modbus-gateway |pipx |ssh )[^`]+)`")


def blocks(text: str) -> list[str]:
    """Return configs, commands with their outputs, and indented lines."""
    return _FENCED.findall(text) + _INDENTED.findall(_FENCED.sub("", text))


@pytest.fixture(scope="module")
def english() -> str:
    pages = [page for page in DOCS.rglob("*.md") if page.parent.name != "zh"]
    return "\n".join(page.read_text(encoding="utf-8") for page in [ROOT / "README.md", *pages])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_each_block_and_command_stands_in_an_english_page_too(page: Path, english: str) -> None:
    text = page.read_text(encoding="utf-8")
    assert [each for each in blocks(text) + _COMMAND.findall(_FENCED.sub("", text)) if each not in english] == []


@pytest.mark.parametrize(("page", "original"), WHOLE.items())
def test_a_whole_page_has_the_blocks_of_the_english_one(page: str, original: str) -> None:
    translated = DOCS / "zh" / f"{page}.md"
    assert blocks(translated.read_text(encoding="utf-8")) == blocks((DOCS / original).read_text(encoding="utf-8"))


def test_each_page_is_in_the_side_bar() -> None:
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    assert [page.stem for page in PAGES if f"\nzh/{page.stem}\n" not in index] == []
