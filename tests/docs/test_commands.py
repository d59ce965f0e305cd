"""The commands that the pages tell a reader to type are commands, with options that they have."""

import re
import shlex
from pathlib import Path

import pytest

from gateway.cli.main import parser_of_all

DOCS = Path(__file__).parents[2] / "docs"
PARSER, VERBS = parser_of_all()
_TYPED = re.compile(r"(?:`|^ {4}(?:\$ )?|&& )(?:sudo )?modbus-gateway ([^`|#\n&>A-Z][^`|#\n&>]*)", re.MULTILINE)


def typed():
    """Each page with each of its commands; a name alone may only be a mention."""
    for page in sorted(DOCS.glob("*.md")):
        for words in sorted({each.strip() for each in _TYPED.findall(page.read_text(encoding="utf-8"))}):
            if words not in VERBS:
                yield page.name, words


@pytest.mark.parametrize(("page", "words"), typed())
def test_a_command_of_a_page_can_be_typed(page, words, capsys):
    try:
        PARSER.parse_args(shlex.split(words))
    except SystemExit as ended:
        assert ended.code == 0, capsys.readouterr().err
