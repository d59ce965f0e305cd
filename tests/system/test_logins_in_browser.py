"""Logging in and out in a browser, what nobody else may do with it, and what only an operator sees."""

import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from gateway.web.text.languages import LANGUAGES
from kit.browser import PASSWORD, USERS
from kit.chromium import (
    EACH_LANGUAGE,
    NEEDS_BROWSER,
    axe_findings,
    in_language,
    look_at_a_desk,
    page_findings,
    phone_findings,
    until,
    until_scripts_run,
    watched,
)
from kit.process import GatewayProcess

pytestmark = NEEDS_BROWSER

#: Some of them the demo has not.
PAGES = (
    "/images/200",
    "/units/41",
    "/config",
    *(pytest.param(each, marks=pytest.mark.search) for each in ("/", "/health")),
)
CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{folder}/hall"
devices = [{{ unit = 1, as = 41, name = "silo", profile = "weigher" }}]

[[image]]
unit = 200
name = "shift"
holding = 10

[web]
bind = "http://127.0.0.1:{port}"
users = "{folder}/users"
write = true
"""
#: Somebody who is not at this machine.
REMOTE = {"X-Forwarded-For": "10.0.0.9"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("web")
    (folder / "users").write_text(USERS)
    (folder / "users").chmod(0o600)
    return folder


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """The address of a gateway with users."""
    with GatewayProcess(folder, CONFIG.format(folder=folder, port=0)) as gateway:
        yield next(event["address"] for event in gateway.log if event["event"] == "web_up")


def log_in(page: Any, address: str, password: str = PASSWORD) -> None:
    page.goto(f"{address}/login?next=/lines/hall")
    page.get_by_label("User").fill("anna")
    page.get_by_label("Password").fill(password)
    press(page, page.get_by_role("button", name="Log in"))


def press(page: Any, button: Any) -> None:
    """Press a button that leads to a page, and wait until that is there."""
    with page.expect_navigation():
        button.click()


def change(users: Path, text: str) -> None:
    """Replace the file at once: the gateway may read it at any moment."""
    new = users.with_suffix(".new")
    new.write_text(text)
    new.chmod(0o600)
    new.replace(users)


@pytest.fixture(scope="module")
def operators_page(browser, address):
    """A page of anna's."""
    with watched(browser) as page:
        log_in(page, address)
        yield page


@pytest.mark.parametrize("language", EACH_LANGUAGE)
@pytest.mark.parametrize("path", PAGES)
def test_a_page_of_an_operator_is_accessible(operators_page, address, path, language):
    look_at_a_desk(operators_page)
    operators_page.goto(f"{address}{in_language(path, language)}")
    until_scripts_run(operators_page)
    operators_page.wait_for_timeout(500)
    assert "anna" in operators_page.locator("header").inner_text()
    found = page_findings if language == "en" else phone_findings  # all but places is the same
    assert found(operators_page) == []


def test_who_is_not_at_this_machine_logs_in_and_gets_to_the_page_that_was_asked_for(browser, address):
    with watched(browser, extra_http_headers=REMOTE) as page:
        page.goto(f"{address}/lines/hall")
        assert urlsplit(page.url).path == "/login"
        log_in(page, address)
        assert urlsplit(page.url).path == "/lines/hall"
        page.goto(f"{address}/config")  # it asks for nothing more that could be refused after the logout
        press(page, page.get_by_role("button", name="Log out"))
        assert urlsplit(page.url).path == "/login"
        page.goto(address)
        assert urlsplit(page.url).path == "/login"


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_wrong_password_is_told_and_lets_nobody_in(browser, address, language):
    why = {"en": "User or password is wrong.", "zh": "用户名或密码错误。"}[language]
    page = browser.new_page(extra_http_headers=REMOTE | {"Accept-Language": language})
    page.goto(f"{address}/login?lang=en")
    log_in(page, address, "wrong horse")
    page.goto(f"{address}/login?lang={language}")
    page.locator("#user").fill("anna")
    page.locator("#password").fill("wrong horse")
    press(page, page.locator("main button"))
    assert page.get_by_role("alert").inner_text() == why
    assert axe_findings(page) == []
    page.goto(address)
    assert urlsplit(page.url).path == "/login"
    page.context.close()


def test_a_forged_token_changes_nothing(browser, address):
    page = browser.new_page()
    log_in(page, address)
    page.evaluate("document.querySelector('header [name=csrf]').value = 'forged'")
    press(page, page.get_by_role("button", name="Log out"))
    assert "X-CSRF-Token must be that of the session" in page.locator("body").inner_text()
    page.goto(address)
    assert "anna (operator)" in page.locator("header").inner_text()
    page.context.close()


@pytest.fixture
def other_site() -> Iterator[str]:
    """A page at another port of this machine, to which browsers send the cookies of the gateway."""

    class Site(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<form method=post><input name=csrf><button>Win</button></form>")

        def log_message(self, *_: object) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Site) as server:
        serving = threading.Thread(target=server.serve_forever)
        serving.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        serving.join()


def test_a_form_of_another_site_changes_nothing_even_with_the_right_token(browser, address, other_site):
    page = browser.new_page()
    log_in(page, address)
    token = page.locator("header [name=csrf]").get_attribute("value")
    page.goto(other_site)
    page.evaluate(
        """([address, token]) => {
            document.forms[0].action = address + "/logout";
            document.forms[0].csrf.value = token;
        }""",
        [address, token],
    )
    with page.expect_request(f"{address}/logout") as sent:
        press(page, page.get_by_role("button"))
    assert "mbgw=" in sent.value.all_headers()["cookie"]
    assert "the Origin of a POST or PUT must be that of this page" in page.locator("body").inner_text()
    page.goto(address)
    assert "anna (operator)" in page.locator("header").inner_text()
    page.context.close()


def test_a_page_whose_session_has_ended_leads_to_the_login_and_back(browser, address, folder):
    page = browser.new_page(extra_http_headers=REMOTE)
    log_in(page, address)
    change(folder / "users", USERS.replace("anna:operator", "anna:viewer"))
    until(page, lambda: urlsplit(page.url).path == "/login")
    log_in(page, address)
    assert "anna (viewer)" in page.locator("header").inner_text()
    change(folder / "users", USERS)
    page.context.close()
