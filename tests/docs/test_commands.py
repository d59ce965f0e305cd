"""The commands that the pages tell a reader to type are commands, with options that they have."""

import re
import shlex
from pathlib import Path

import pytest

from gateway.cli.main import parser_of_all

DOCS = Path(__file__).parents[2] / "docs"
PARSER, VERBS = parser_of_all()
_TYPED = re.compile(r"(?:`|^ {4,}(?:\$ )?|&& )(?:sudo )?modbus-gateway ([^`|#\n&>A-Z][^`|#\n&>]*)", re.MULTILINE)


def typed(page):
    """Each command of a page; a name alone may only be a mention."""
    return sorted({each.strip() for each in _TYPED.findall(page.read_text(encoding="utf-8"))} - VERBS.keys())


COMMANDS = [(page.name, words) for page in sorted(DOCS.glob("*.md")) for words in typed(page)]


@pytest.mark.parametrize(("page", "words"), COMMANDS)
def test_a_command_of_a_page_can_be_typed(page, words, capsys):
    status = 0
    try:
        PARSER.parse_args(shlex.split(words))
    except SystemExit as ended:
        status = ended.code  # 0 after --help
    assert status == 0, capsys.readouterr().err
