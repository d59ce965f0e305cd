"""The page where a change of the config is prepared: it checks a text, and writes nothing."""

from collections.abc import Sequence

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.config.reading.masking import shown
from gateway.config.reading.whole_text import parted
from gateway.operator.config.check import check_config
from gateway.operator.operations.answers.config import CheckedConfig
from gateway.operator.operations.asked import TextToCheck
from gateway.web.api.asking import asker_of
from gateway.web.front.bodies import FORM, FORM_TYPE
from gateway.web.front.problems import ProblemError
from gateway.web.pages.page import Page, route


class ConfigChangePage(Page):
    """The handlers of `/config/change`."""

    @route("GET", "/config/change")
    async def begin(self, request: web.Request) -> web.Response:
        """Show the form, with the config in use as far as it may be shown."""
        own, _ = parted(self._operator.reloader.text)
        text = await in_thread("web config", shown, own)
        return await self._page(request, text, None)

    @route("POST", "/config/change", "operator")
    async def check(self, request: web.Request) -> web.Response:
        """Check the text of the form, and show it again, unless the form has `only_result`.

        Raises:
            Unready: too many others have theirs checked.
            ProblemError: it is no form.
        """
        form = _form(request)
        text = form.get("text", "").replace("\r\n", "\n")
        checked = await check_config(self._operator, TextToCheck(text), asker_of(request))
        return await self._page(request, "" if "only_result" in form else text, checked, text.split("\n"))

    @route("POST", "/config/change/text", "operator")
    async def download(self, request: web.Request) -> web.Response:
        """Return the text of the form as a file, with the name of the config.

        Raises:
            ProblemError: it is no form.
        """
        name = self._operator.reloader.file.name
        safe = "".join(each if (each.isalnum() and each.isascii()) or each in ".-_" else "_" for each in name)
        return web.Response(
            text=_form(request).get("text", "").replace("\r\n", "\n"),
            content_type="application/toml",
            headers={"Content-Disposition": f'attachment; filename="{safe}"', "Cache-Control": "no-store"},
        )

    async def _page(
        self, request: web.Request, text: str, checked: CheckedConfig | None, lines: Sequence[str] = ()
    ) -> web.Response:
        return await self._renderer.page(
            "config_change.html",
            request,
            text=text,
            checked=checked,
            lines=lines,
        )


def _form(request: web.Request) -> dict[str, str]:
    if FORM not in request:
        raise ProblemError(415, f"forms are {FORM_TYPE}")
    return request[FORM]
