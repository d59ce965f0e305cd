"""The languages of the pages: English, in which templates and scripts are written, and those with a catalogue.

Translators edit `CODE/LC_MESSAGES/messages.po`. `python -m deploy.translations` puts new texts into it, and compiles
it: for gettext, and for scripts (`pages/static/texts`).
"""

import gettext
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from aiohttp import web

from gateway.web.text.cookies import cookie, keep
from gateway.web.text.words import ENGLISH as ENGLISH_OF

FOLDER: Final = Path(__file__).parent
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


def texts_of(language: Language) -> gettext.NullTranslations:
    """Read the texts of a language; what has no translation stays English."""
    return gettext.translation("messages", FOLDER, [language.code], fallback=language is ENGLISH)


def word_of(texts: gettext.NullTranslations) -> Callable[[str], str]:
    """Make what translates a word of the gateway, also with the code of an exception: `timeout`, `exception 0A`."""

    def word(name: str) -> str:
        what, _, code = name.partition(" ")
        if what == "exception" and len(code) == len("0A"):
            return texts.gettext("exception %(code)s") % {"code": code}
        return name and texts.gettext(ENGLISH_OF.get(name, name))

    return word
