"""The languages of the pages: English, in which templates are written, and tables of translations.

`translations/CODE/PAGE.json` has the texts of `templates/PAGE.html`. The other files there have words that come from
the gateway, states and results; English has some of these too, for names that are no words, as `bad_frame`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from aiohttp import web

from gateway.web.text.cookies import cookie, keep

FOLDER: Final = Path(__file__).parent / "translations"
#: What a browser keeps the choice in.
COOKIE: Final = "mbgw-lang"
#: This many languages of an Accept-Language are looked at: browsers send fewer.
_MOST_PREFERRED: Final = 32


@dataclass(frozen=True, slots=True)
class Language:
    """A language: `code` in addresses, `tag` in HTML, and its own name."""

    code: str
    tag: str
    name: str


ENGLISH: Final = Language("en", "en", "English")
#: All languages by their codes.
LANGUAGES: Final[Mapping[str, Language]] = {each.code: each for each in (ENGLISH, Language("zh", "zh-CN", "中文"))}


def language_of(request: web.Request) -> Language:
    """Choose the language that the address asks for (`?lang=zh`), or the cookie, or what the browser prefers."""
    for code in (request.query.get("lang", ""), cookie(request, COOKIE)):
        if code in LANGUAGES:
            return LANGUAGES[code]
    return preferred(request.headers.get("Accept-Language", ""))


def keep_language(request: web.Request, response: web.Response, *, is_encrypted: bool) -> None:
    """Let the browser keep the language that its user has chosen by an address."""
    code = request.query.get("lang", "")
    if code in LANGUAGES:
        keep(request, response, COOKIE, code, is_encrypted=is_encrypted)


def preferred(header: str) -> Language:
    """Choose the language that an Accept-Language prefers among ours; English if it names none of them."""
    best, weight = ENGLISH, 0.0
    for part in header.split(",", _MOST_PREFERRED)[:_MOST_PREFERRED]:
        tag, _, parameter = part.partition(";")
        language = LANGUAGES.get(tag.strip().lower().partition("-")[0])
        if language is not None and (quality := _quality(parameter)) > weight:
            best, weight = language, quality
    return best


def _quality(parameter: str) -> float:
    name, _, value = parameter.partition("=")
    try:
        return float(value) if name.strip().lower() == "q" else 1.0
    except ValueError:
        return 0.0


class Texts:
    """The texts of the pages in one language. Reading them takes some milliseconds."""

    def __init__(self, language: Language) -> None:
        self._table: dict[str, str] = {}
        for file in sorted((FOLDER / language.code).glob("*.json")):
            self._table.update(json.loads(file.read_text(encoding="utf-8")))

    def text(self, english: str) -> str:
        """Translate a text of a template; what has no translation stays English."""
        return self._table.get(english, english)

    def word(self, english: str) -> str:
        """Translate a word of the gateway, also with the code of an exception: `timeout`, `exception 0A`."""
        name, space, code = english.partition(" ")
        return self.text(name) + space + code if name == "exception" else self.text(english)

    def counted(self, one: str, many: str, count: int) -> str:
        """Translate a text that differs with a number; the table has the plural."""
        return self._table.get(many, one if count == 1 else many)
