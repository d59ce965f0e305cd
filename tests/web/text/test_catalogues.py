"""The catalogues: each text and word of the pages is in them, translated, and nothing else is."""

import ast
import gettext
import re
import shutil
from operator import attrgetter
from pathlib import Path
from unittest.mock import patch

import pytest
from jinja2 import Environment

import gateway
from deploy.gateway_words import ENGLISH, OF_RIGHTS, words
from deploy.translations import CATALOGUES, SCRIPTS, all_catalogues, update
from deploy.translations import script as script_of
from gateway.web.pages.renderer import FOLDER as TEMPLATES
from gateway.web.text.languages import LANGUAGES

PAGES = sorted(TEMPLATES.glob("*.html"))
#: What stands on a page in every language.
NAMES = {"modbus-gateway", "API", "s"}
PLACEHOLDER = re.compile(r"%\(\w+\)s")
HTML = re.compile(r"<[^>]*>?|&\w*;?|>")
#: A call in a script that translates: of a constant, or not.
CALL = re.compile(r'(?<![\w.$])(?:_|ngettext|pgettext)\((?:"((?:[^"\\]|\\.)*)")?')


@pytest.fixture(params=list(all_catalogues()), ids=lambda each: each[0])
def messages(request):
    """The messages of a language, without the head of its file."""
    return [message for message in request.param[1] if message.id]


def forms(text):
    return [text] if isinstance(text, str) else list(text)


def test_each_language_has_a_catalogue():
    assert {language for language, _ in all_catalogues()} == set(LANGUAGES) - {"en"}


def test_nothing_is_left_to_translate(messages):
    for message in messages:
        assert all(text.strip() for text in forms(message.string)), message.id
        assert not message.fuzzy, message.id


def test_a_translation_has_the_placeholders_of_its_text(messages):
    for message in messages:
        wanted = set(PLACEHOLDER.findall(forms(message.id)[-1]))
        for text in forms(message.string):
            assert set(PLACEHOLDER.findall(text)) == wanted, message.id
            assert "%" not in PLACEHOLDER.sub("", text).replace("%%", ""), message.id


def test_a_translation_brings_no_html_of_its_own(messages):
    """A page takes it as it is."""
    for message in messages:
        wanted = sorted(HTML.findall(forms(message.id)[-1]))
        assert all(sorted(HTML.findall(text)) == wanted for text in forms(message.string)), message.id


def test_what_a_catalogue_says_of_plurals_is_no_other_code():
    """It becomes a function of a script."""
    _, catalogue = next(all_catalogues())
    catalogue._plural_expr = "alert(n)"
    with pytest.raises(ValueError, match="plural"):
        script_of(catalogue)


def test_catalogues_are_those_of_the_pages(tmp_path):
    """`nox -s gen` writes them anew."""
    shutil.copytree(CATALOGUES, tmp_path / "text")
    update(tmp_path / "text", tmp_path / "scripts")
    assert contents(tmp_path / "text", tmp_path / "scripts") == contents(CATALOGUES, SCRIPTS)


def contents(catalogues, scripts):
    """What is in the files, but for the version of Babel."""
    compiled = {}
    for file in catalogues.glob("*/LC_MESSAGES/messages.mo"):
        with file.open("rb") as texts:
            compiled[file.parts[-3]] = gettext.GNUTranslations(texts)._catalog | {"": ""}
    edited = [re.sub(r'"Generated-By.*', "", each.read_text()) for each in sorted(catalogues.glob("*/*/*.po"))]
    return compiled, edited, {file.name: file.read_text() for file in scripts.iterdir()}


def test_each_word_of_the_gateway_is_in_the_catalogue(messages):
    assert {ENGLISH.get(word, word) for word in words()} <= {forms(message.id)[0] for message in messages}


def test_each_word_that_is_listed_is_one_of_the_gateway():
    constants = {
        node.value
        for file in Path(gateway.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and file.name != "words.py"
    }
    assert {*OF_RIGHTS, *ENGLISH} <= constants


@pytest.mark.parametrize("page", PAGES, ids=attrgetter("stem"))
def test_a_page_translates_constants_only(page):
    environment = Environment(extensions=["jinja2.ext.i18n"], autoescape=True)
    for line, _, message in environment.extract_translations(page.read_text()):
        assert message is not None, f"line {line}: word() is for what is no constant"


@pytest.mark.parametrize("page", PAGES, ids=attrgetter("stem"))
def test_a_page_has_no_text_that_cannot_be_translated(page):
    source = page.read_text()
    source = re.sub(r"\{% trans.*?endtrans %\}|\{%.*?%\}|\{\{.*?\}\}|\{#.*?#\}", "", source, flags=re.DOTALL)
    shown = re.findall(r">([^<]*)<", source) + re.findall(r'(?:aria-label|title|placeholder|alt)="([^"]*)"', source)
    assert set(re.findall(r"[^\W\d_][\w-]*", " ".join(shown))) <= NAMES


@pytest.mark.parametrize("script", sorted(SCRIPTS.parent.glob("*.js")), ids=attrgetter("stem"))
def test_each_text_of_a_script_is_in_the_catalogue(script, messages):
    """Babel reads scripts roughly, braces in template strings for example: what it overlooks is found here."""
    file = script.relative_to(Path(__file__).parents[3]).as_posix()
    known = {
        text
        for message in messages
        if file in dict(message.locations)
        for text in (message.context, forms(message.id)[0])
    }
    for call in CALL.finditer(script.read_text()):
        assert call[1] in known, f"{script.name}: {call[0]}"


def test_a_third_language_needs_its_name_in_the_list(tmp_path):
    """Polish has three plurals."""
    texts, scripts = tmp_path / "text", tmp_path / "scripts"
    with patch("deploy.translations.LANGUAGES", {"en": None, "pl": None}):
        update(texts, scripts)
    file = texts / "pl" / "LC_MESSAGES" / "messages.po"
    of_bytes = 'msgid "%(count)s byte"\nmsgid_plural "%(count)s bytes"\n'
    filled = "".join(f'msgstr[{at}] "%(count)s {text}"\n' for at, text in enumerate(("bajt", "bajty", "bajtów")))
    file.write_text(re.sub(re.escape(of_bytes) + r'(?:msgstr\[\d\] ""\n)+', of_bytes + filled, file.read_text()))
    update(texts, scripts)
    polish = gettext.translation("messages", texts, ["pl"])
    several = [polish.ngettext("%(count)s byte", "%(count)s bytes", count) for count in (1, 2, 5)]
    assert several == ["%(count)s bajt", "%(count)s bajty", "%(count)s bajtów"]
    assert polish.gettext("Overview") == "Overview"
    script = (scripts / "pl.js").read_text()
    assert '"%(count)s bajtów"' in script
    assert "n%10>=2" in script.replace(" ", "")
