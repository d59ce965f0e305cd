"""The manual pages: made of what the command line and the config understand."""

import re
import subprocess
from argparse import SUPPRESS

import pytest

from deploy.manual_pages import pages
from deploy.roff import manual_page
from gateway.cli.kit.examples import EXAMPLES
from gateway.cli.main import VERBS, parser_of_all
from gateway.config.schema.config import Config
from gateway.config.schema.table import keys_of, row_model

PAGES = pages()


def shown(page):
    """The page as it is read: without what roff is told."""
    return re.sub(r"\\f[BIR]|\\%", "", page).replace("\\-", "-").replace("\\(aq", "'").replace("\\e", "\\")


COMMAND, CONFIG = (shown(page) for page in PAGES.values())


def options(parser):
    """The options of a parser and of those in it, each with the name of its command."""
    for action in (each for each in parser._actions if each.help != SUPPRESS):
        yield from ((parser.prog, flag) for flag in action.option_strings)
        if isinstance(action.choices, dict):
            for each in action.choices.values():
                yield from options(each)


def test_the_page_has_every_command_with_its_options_and_examples():
    sections = dict(re.findall(r"^\.SS (.*)\n((?s:.*?))(?=^\.S[SH])", COMMAND, re.MULTILINE))
    assert {name.split()[1] for name in sections} == set(VERBS)
    for command, flag in options(parser_of_all()[0]):
        if command != "modbus-gateway" and flag not in ("-h", "--help"):
            assert re.search(rf"^(\S.*, )?{flag}\b", sections[command], re.MULTILINE), (command, flag)
    for typed in (typed for verb in VERBS for typed, _ in EXAMPLES[verb]):
        assert f"\nmodbus-gateway {typed}\n" in COMMAND


@pytest.mark.parametrize(("key", "field"), list(zip(keys_of(Config), Config.model_fields.values(), strict=True)))
def test_the_page_of_the_config_has_every_key(key, field):
    assert key in CONFIG
    for inner in keys_of(row_model(field.annotation)) if row_model(field.annotation) else ():
        assert re.search(rf"^\.TP\n{inner}; ", CONFIG, re.MULTILINE)


def test_a_key_is_told_with_its_values_its_default_and_its_meaning():
    assert "\n.TP\nbaud; number; default 19200\nAny rate; 14400 and other odd ones are set as custom rates.\n" in CONFIG


@pytest.mark.needs("groff")
@pytest.mark.parametrize("page", PAGES)
def test_roff_has_no_complaints_about_the_page(page):
    words = ["groff", "-man", "-Tutf8", "-ww", "-z"]
    done = subprocess.run(words, input=PAGES[page], capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("markdown", "roff"),
    [
        ("# See also", ".SH SEE ALSO"),
        ("### `[[line]]`", ".SS \\fB\\%[[line]]\\fR"),
        ("one\ntwo `three four`", ".PP\none two \\fB\\%three \\%four\\fR"),
        (".begins like a request", ".PP\n\\&.begins like a request"),
        ("back\\slash and don't", ".PP\nback\\eslash and don\\(aqt"),
        ("[a page](page.md#part), [TOML](https://toml.io)", ".PP\na page, TOML (\\%https://toml.io)"),
        ("- one\n  more\n- two", ".IP \\(bu 4\none more\n.IP \\(bu 4\ntwo"),
        ("```toml\na\n\n.b\n```", ".PP\n.RS 4\n.EX\na\n\n\\&.b\n.EE\n.RE"),
        ("| a | b |\n|---|---|\n| `x\\|y` | is *it* |", ".TP\n\\fB\\%x|y\\fR\nis \\fIit\\fR"),
        ("<!-- made\nby -->\n\ntext", ".PP\ntext"),
    ],
)
def test_markdown_becomes_roff(markdown, roff):
    assert manual_page("x", 1, "Pages", markdown).partition(".ad l\n")[2] == f"{roff}\n"


def test_the_running_program_has_one_name():
    """Pages and messages call it the gateway."""
    assert "daemon" not in COMMAND.casefold()
