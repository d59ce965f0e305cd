"""Keeps the translations of the pages: new texts go into each language's `messages.po`, which is then compiled.

    .venv/bin/python -m deploy.translations

It runs Babel: `pybabel extract`, `update` and `compile`; then it writes what scripts need of each language. One that is
new in LANGUAGES gets its `messages.po`. Why: docs/adr/0047-translations.md.
"""

import json
import sys
from collections.abc import Iterator
from contextlib import chdir
from gettext import c2py
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from babel.messages import Catalog
from babel.messages.frontend import CommandLineInterface
from babel.messages.pofile import read_po

from gateway.web.text.languages import ENGLISH, LANGUAGES

_CHECKOUT: Final = Path(__file__).parents[1]
_WEB: Final = _CHECKOUT / "gateway" / "web"
#: The catalogues, one for each language, and what scripts get of them.
CATALOGUES: Final = _WEB / "text"
SCRIPTS: Final = _WEB / "pages" / "static" / "texts"
_WIDTH: Final = "--width=120"


def update(catalogues: Path = CATALOGUES, scripts: Path = SCRIPTS) -> None:
    """Write all files anew: a text that is not used any more goes, one that is new has no translation yet."""
    with TemporaryDirectory() as folder:
        template = f"{folder}/messages.pot"
        extract(template)
        for code in LANGUAGES.keys() - {ENGLISH.code}:
            if not (catalogues / code).exists():
                babel("init", "-i", template, "-d", catalogues, "-l", code, _WIDTH)
        babel(
            "update", "-i", template, "-d", catalogues, "-N", "--ignore-obsolete", "--ignore-pot-creation-date", _WIDTH
        )
    babel("compile", "-d", catalogues)
    scripts.mkdir(exist_ok=True)
    for language, catalogue in all_catalogues(catalogues):
        (scripts / f"{language}.js").write_text(script(catalogue), encoding="utf-8")


def extract(template: str) -> None:
    """Write all texts of the pages, in English."""
    keywords = ("-k", "word", "--add-location=file", "--sort-output", "--project=modbus-gateway", _WIDTH)
    with chdir(_CHECKOUT):  # the catalogues name files from there
        babel("extract", "-F", "deploy/babel.toml", *keywords, "-o", template, "gateway")


def all_catalogues(folder: Path = CATALOGUES) -> Iterator[tuple[str, Catalog]]:
    """Read the catalogue of each language."""
    for file in sorted(folder.glob("*/LC_MESSAGES/messages.po")):
        with file.open("rb") as text:
            yield file.parts[-3], read_po(text)


def script(catalogue: Catalog) -> str:
    """Make the module with the texts of scripts, by their English, and which of its plurals a count takes.

    Raises:
        ValueError: what the catalogue says of plurals is no expression of gettext.
    """
    texts: dict[str, Any] = {}
    for message in catalogue:
        if message.string and all(message.string) and any(place.endswith(".js") for place, _ in message.locations):
            english = message.id[0] if message.pluralizable else message.id
            texts[f"{message.context}\x04{english}" if message.context else english] = message.string
    table = json.dumps(texts, ensure_ascii=False, indent=0)
    c2py(catalogue.plural_expr)  # what a translator has written there becomes code
    return f"export const plural = (n) => Number({catalogue.plural_expr});\nexport const texts = {table};\n"


def babel(*arguments: str | Path) -> None:
    """Run a command of Babel's.

    Raises:
        SystemExit: it has found what is wrong, and told it.
    """
    if CommandLineInterface().run(["pybabel", "--quiet", *map(str, arguments)]):
        sys.exit(1)


if __name__ == "__main__":
    update()
