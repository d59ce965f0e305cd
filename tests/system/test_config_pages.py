"""The pages of the config in a real browser: a change is prepared with and without scripts, and taken back."""

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from kit.browser import PASSWORD, USERS
from kit.chromium import NEEDS_BROWSER, look_at_a_desk, page_findings, until
from kit.process import GatewayProcess

pytestmark = NEEDS_BROWSER

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 200
name = "shift"
holding = 20 # as the panel has them

[web]
bind = "http://127.0.0.1:0"
users = "{folder}/users"
"""


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    folder = tmp_path_factory.mktemp("gateway")
    (folder / "users").write_text(USERS)
    (folder / "users").chmod(0o600)
    with GatewayProcess(folder, CONFIG.format(folder=Path(folder)), level="info") as running:
        (address,) = (event["address"] for event in running.log if event["event"] == "web_up")
        yield SimpleNamespace(address=address, process=running, folder=folder)


@pytest.fixture(scope="module")
def annas(gateway: SimpleNamespace, browser: Any) -> dict[str, Any]:
    """What a browser needs in which anna is logged in."""
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(f"{gateway.address}/login")
    page.locator("input[name=user]").fill("anna")
    page.locator("input[name=password]").fill(PASSWORD)
    page.locator(".login button").click()
    kept = {"storage_state": context.storage_state()}
    context.close()
    return kept


@pytest.fixture
def plain(browser: Any, annas: dict[str, Any]) -> Iterator[Any]:
    context = browser.new_context(java_script_enabled=False, **annas)
    yield context.new_page()
    context.close()


@pytest.fixture
def page(gateway: SimpleNamespace, browser: Any, annas: dict[str, Any]) -> Iterator[Any]:
    """The page of a change, with JavaScript; nothing may be wrong in its console."""
    context = browser.new_context(**annas)
    page = context.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(f"{gateway.address}/config/change")
    page.locator(".editor .numbers").wait_for()
    yield page
    context.close()
    assert complaints == []


def write(page: Any, text: str) -> None:
    """Write at the end of the text."""
    page.locator("textarea").focus()
    page.keyboard.press("Control+End")
    page.keyboard.type(text)


def test_a_change_is_prepared_without_javascript(gateway: SimpleNamespace, plain: Any) -> None:
    plain.goto(f"{gateway.address}/config")
    plain.get_by_role("link", name="Prepare a change").click()
    area = plain.locator("textarea")
    text = area.input_value()
    assert "as the panel has them" not in text
    area.fill(text.replace("holding = 20", "holdings = 20"))
    plain.get_by_role("button", name="Check").click()
    assert "image[0].holdings: unknown key" in plain.locator("[data-result]").inner_text()
    area.fill(text.replace("holding = 20", "holding = 30"))
    plain.get_by_role("button", name="Check").click()
    result = plain.locator("[data-result]").inner_text()
    assert "image shift" in result
    assert "+holding = 30" in result
    assert f"{gateway.process.config}.new" in result


def test_what_check_says_stands_beside_the_lines_while_one_writes(page: Any) -> None:
    write(page, "\n[trace]\nrimg = 3\n")
    row = page.locator(".beside .error")
    row.wait_for()
    line = page.locator("textarea").input_value().split("\n").index("rimg = 3") + 1
    assert "trace.rimg: unknown key" in row.inner_text()
    assert page.locator(".numbers .error").inner_text() == str(line)
    mark, text = (page.locator(each).bounding_box() for each in (".numbers .error", ".beside .error"))
    assert abs(mark["y"] - text["y"]) < 6
    page.locator("button.place").first.click()
    assert page.evaluate(
        "document.activeElement.value.slice(document.activeElement.selectionStart).split('\\n')[0]"
    ) == ("rimg = 3")


def test_keys_and_values_are_completed(page: Any) -> None:
    write(page, "\n[lo")
    chosen = page.locator(".completion [aria-selected=true]")
    page.locator(".completion:not([hidden])").wait_for()
    page.keyboard.press("ArrowDown")
    assert chosen.inner_text().startswith("log")
    page.keyboard.press("Enter")
    page.keyboard.type("\nlev")
    page.locator(".completion:not([hidden])").wait_for()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    page.keyboard.press("Control+Space")
    page.locator(".completion li", has_text="debug").click()
    assert page.locator("textarea").input_value().endswith('\n[log]\nlevel = "debug"')


def test_a_key_of_a_table_in_a_list_is_completed(page: Any) -> None:
    write(page, '\n[[line]]\nport = "/dev/ttyS9"\ndevices = [{ unit = 1, pri')
    page.locator(".completion:not([hidden])").wait_for()
    assert page.locator(".completion code").all_inner_texts() == ["priority"]
    page.keyboard.press("Escape")
    page.keyboard.type('ority = "h')
    page.locator(".completion:not([hidden])").wait_for()
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    assert page.locator("textarea").input_value().endswith('priority = "high"')


def test_tab_leaves_the_text_even_with_completions(page: Any) -> None:
    write(page, "\n[lo")
    page.locator(".completion:not([hidden])").wait_for()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Check"
    assert page.locator("textarea").input_value().endswith("\n[lo")
    page.keyboard.press("Shift+Tab")
    assert page.evaluate("document.activeElement.name") == "text"


def test_enter_is_a_new_line_unless_a_completion_was_chosen(page: Any) -> None:
    write(page, "\n[lo")
    page.locator(".completion:not([hidden])").wait_for()
    page.keyboard.press("Enter")
    assert page.locator("textarea").input_value().endswith("\n[lo\n")


def test_a_file_is_opened_and_the_text_is_downloaded_with_its_comments(page: Any, tmp_path: Path) -> None:
    own = tmp_path / "own.toml"
    own.write_text('# kept\n[[image]]\nunit = 7\nname = "own"\nholding = 4\n')
    page.locator("input[type=file]").set_input_files(own)
    until(page, lambda: "image own" in page.locator("[data-result]").inner_text())
    with page.expect_download() as download:
        page.get_by_role("button", name="Download").click()
    assert download.value.path().read_text() == own.read_text()
    assert download.value.suggested_filename == "gateway.toml"


def test_the_page_of_a_change_is_accessible(page: Any) -> None:
    look_at_a_desk(page)
    write(page, "\n[trace]\nrimg = 3\n[lo")
    page.locator(".beside .error").wait_for()
    page.keyboard.press("Control+Space")
    page.locator(".completion:not([hidden])").wait_for()
    assert page_findings(page) == []


def test_a_config_from_before_is_taken_back_by_the_commands(gateway: SimpleNamespace, plain: Any) -> None:
    file, process = Path(gateway.process.config), gateway.process
    before = file.read_text()
    file.write_text(before.replace("holding = 20", "holding = 25"))
    process.signal(signal.SIGHUP)
    process.wait_for("config_applied")
    until(plain, lambda: len(list((gateway.folder / "configs").iterdir())) == 2)
    plain.goto(f"{gateway.address}/config")
    plain.locator("a[href^='/config/applied/']").nth(1).click()
    assert "+holding = 25" in plain.locator("main").inner_text()
    back = plain.locator("main pre", has_text="install").inner_text().replace("modbus-gateway", "true modbus-gateway")
    assert subprocess.run(["sh", "-ec", back], check=False).returncode == 0
    assert file.read_text() == before
    process.signal(signal.SIGHUP)
    process.wait_for("config_applied")
    plain.goto(f"{gateway.address}/config")
    assert plain.locator("a[href^='/config/applied/']").count() == 3


def test_the_page_of_a_config_from_before_is_accessible(gateway: SimpleNamespace, browser: Any, annas: Any) -> None:
    context = browser.new_context(**annas)
    page = context.new_page()
    look_at_a_desk(page)
    page.goto(f"{gateway.address}/config")
    page.locator("a[href^='/config/applied/']").last.click()
    page.locator("h2").first.wait_for()
    assert page_findings(page) == []
    context.close()
