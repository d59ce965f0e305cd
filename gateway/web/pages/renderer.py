"""Makes pages from templates."""

import gzip
from collections.abc import Callable, Mapping
from pathlib import Path
from types import CodeType
from typing import Any, Final

from aiohttp import web
from jinja2 import BytecodeCache, Environment, FileSystemLoader, StrictUndefined
from jinja2.bccache import Bucket

from gateway.clock import threads
from gateway.clock.slices import with_rests
from gateway.config.values.unitset import show_units
from gateway.version import DOCUMENTATION, __version__
from gateway.web.access.guard import VISITOR
from gateway.web.front.turns import Turns
from gateway.web.pages.assets import Assets
from gateway.web.pages.head import Heads
from gateway.web.text.languages import LANGUAGES, Language, keep_language, language_of, texts_of, word_of
from gateway.web.text.themes import DARK, keep_theme, theme_of

FOLDER: Final = Path(__file__).parent / "templates"
_HEADERS: Final = {"Cache-Control": "no-store", "Vary": "Accept-Language, Cookie"}


#: The gzip level of pages: higher ones are slower, and save next to nothing.
_PACKING: Final = 4


class _Compiled(BytecodeCache):
    """Compiled templates, shared by all languages: texts are looked up when they are used."""

    def __init__(self) -> None:
        self._templates: dict[str, CodeType | None] = {}

    def load_bytecode(self, bucket: Bucket) -> None:
        bucket.code = self._templates.get(bucket.key)

    def dump_bytecode(self, bucket: Bucket) -> None:
        self._templates[bucket.key] = bucket.code


_COMPILED: Final = _Compiled()


class Renderer:
    """Makes pages, one at a time and in a thread: the lines do not wait for them."""

    def __init__(self, assets: Assets, heads: Heads, *, is_encrypted: bool) -> None:
        self._heads = heads
        self._turns = Turns()
        self._is_encrypted = is_encrypted
        self._templates = {code: _templates(language, assets) for code, language in LANGUAGES.items()}

    async def page(
        self,
        template: str,
        request: web.Request,
        in_thread: Callable[[], Mapping[str, Any]] = dict,
        **content: Any,
    ) -> web.Response:
        """Make a page from a template and this content, in the language of the request.

        `in_thread` is called in the thread that makes the page; it adds to the content.

        Raises:
            HTTPServiceUnavailable: the client has disconnected before its turn.
        """
        language = language_of(request)
        # A path that begins with // would lead to another host.
        path, chosen = f"/{request.rel_url.raw_path.lstrip('/')}", request.rel_url.update_query
        others = [(each, f"{path}?{chosen(lang=each.code).raw_query_string}") for each in LANGUAGES.values()]
        theme = theme_of(request)
        frame = {
            "visitor": request[VISITOR],
            "path": request.path,
            "head": await self._heads.of(request[VISITOR]),
            "is_kiosk": "kiosk" in request.query,
            "other_languages": [(each, address) for each, address in others if each is not language],
            "theme": theme,
            "dark": DARK[theme],
            "themes": [(each, f"{path}?{chosen(theme=each).raw_query_string}") for each in DARK],
        }
        is_packed = "gzip" in request.headers.get("Accept-Encoding", "")
        async with self._turns.turn(request):
            body = await self._rendered(language, template, {**frame, **content}, in_thread, is_packed=is_packed)
        headers = {**_HEADERS, "Content-Encoding": "gzip"} if is_packed else _HEADERS
        response = web.Response(body=body, content_type="text/html", charset="utf-8", headers=headers)
        keep_language(request, response, is_encrypted=self._is_encrypted)
        keep_theme(request, response, is_encrypted=self._is_encrypted)
        return response

    async def _rendered(
        self,
        language: Language,
        template: str,
        content: Mapping[str, Any],
        in_thread: Callable[[], Mapping[str, Any]],
        *,
        is_packed: bool,
    ) -> bytes:
        templates = self._templates[language.code]

        def make() -> bytes:
            text = "".join(with_rests(templates.get_template(template).generate({**content, **in_thread()}))).encode()
            return gzip.compress(text, _PACKING) if is_packed else text

        return await threads.in_thread("web page", make)


def _templates(language: Language, assets: Assets) -> Environment:
    """Load the templates in one language: imported macros see the texts of their environment, and no others."""
    templates = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        auto_reload=False,
        bytecode_cache=_COMPILED,
        extensions=["jinja2.ext.i18n"],
    )
    texts = texts_of(language)
    templates.install_gettext_translations(texts, newstyle=True)  # type: ignore[attr-defined]
    templates.globals |= {
        "word": word_of(texts),
        "language": language,
        "asset": assets.address,
        "version": __version__,
        "documentation": DOCUMENTATION,
        "show_units": show_units,
    }
    return templates
