"""Pages of units and images in a real browser: values are read and written, once and only after a yes."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from kit.browser import PASSWORD, USERS
from kit.chromium import NEEDS_BROWSER
from kit.device import SimulatedDevice, SimulatedLine
from kit.process import PATIENCE, GatewayProcess
from kit.pty import VirtualPort
from kit.serial_line import SerialDevices

pytestmark = NEEDS_BROWSER

CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall"
port = "{folder}/hall"

[[line.devices]]
unit = 1
name = "press"
timeout = "20 s"
points = [{{ name = "speed", holding = 0, scale = 0.1, decimals = 1, unit = "rpm", write = true }}]

[[image]]
unit = 200
name = "shift"
holding = 20

[web]
bind = "http://127.0.0.1:0"
users = "{folder}/users"
write = true
"""


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    """A gateway with a device, and two users."""
    folder = tmp_path_factory.mktemp("gateway")
    (folder / "users").write_text(USERS)
    (folder / "users").chmod(0o600)
    device = SimulatedDevice(1)
    process = GatewayProcess(folder, CONFIG.format(folder=Path(folder)), level="info")
    port = VirtualPort(folder / "hall")
    with port, SerialDevices({port: SimulatedLine("rtu", device)}), process as running:
        (address,) = (event["address"] for event in running.log if event["event"] == "web_up")
        yield SimpleNamespace(address=address, device=device, log=running.log)


@pytest.fixture(scope="module")
def annas(gateway: SimpleNamespace, browser: Any) -> dict[str, Any]:
    """What a browser needs in which anna is logged in; she did it without JavaScript."""
    context = browser.new_context(java_script_enabled=False)
    log_in(gateway, context.new_page(), "anna")
    kept = {"storage_state": context.storage_state()}
    context.close()
    return kept


@pytest.fixture(params=[True, False], ids=["with-javascript", "without-javascript"])
def page(
    gateway: SimpleNamespace, browser: Any, annas: dict[str, Any], request: pytest.FixtureRequest
) -> Iterator[Any]:
    """A page of anna's."""
    context = browser.new_context(java_script_enabled=request.param, **annas)
    page = context.new_page()
    page.goto(f"{gateway.address}/units/press")
    yield page
    context.close()


@pytest.fixture
def heard(gateway: SimpleNamespace) -> Callable[[], list[str]]:
    """What was written to the device since the test began."""
    begin = len(gateway.device.heard)
    gateway.device.holding[0] = 120
    return lambda: [frame.pdu.hex() for frame in gateway.device.heard[begin:] if frame.pdu[0] not in (1, 2, 3, 4)]


def log_in(gateway: SimpleNamespace, page: Any, user: str) -> Any:
    page.goto(f"{gateway.address}/login?next=/units/press")
    page.fill("#user", user)
    page.fill("#password", PASSWORD)
    page.click("form.login button")
    page.wait_for_url("**/units/press")
    return page


def ask_for(page: Any, value: str) -> None:
    """Send the form of the point; the page with the question is there then."""
    row = page.locator("tr[data-point=speed]")
    row.locator("input[name=value]").fill(value)
    row.get_by_role("button", name="Write …").click()
    page.wait_for_url("**/units/press/writes/*")
    assert page.get_by_role("heading", name="Write this?").is_visible()


def audits(gateway: SimpleNamespace) -> list[dict[str, Any]]:
    return [event for event in gateway.log if event["event"] == "write_audit"]


def until(is_so: Callable[[], bool], page: Any) -> None:
    end = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def test_a_write_shows_old_and_new_asks_arrives_once_and_is_audited(gateway, page, heard):
    before = len(audits(gateway))
    ask_for(page, "12.5")
    row = page.locator("table.writes tbody tr")
    assert [row.locator("td").nth(at).inner_text() for at in (0, 2, 3)] == ["12.0", "12.5", "rpm"]
    assert heard() == []
    page.get_by_role("button", name="Write now").dblclick()
    page.get_by_role("heading", name="It is written").wait_for()
    page.reload()
    page.go_back()
    page.go_forward()
    page.get_by_role("heading", name="It is written").wait_for()
    assert heard() == ["06" + "0000" + "007d"]
    until(lambda: len(audits(gateway)) > before, page)
    (audit,) = audits(gateway)[before:]
    assert (audit["client"], audit["listener"], audit["unit"], audit["result"]) == (
        "web:anna@127.0.0.1",
        "web",
        1,
        "ok",
    )


def test_an_exception_is_told_in_words(gateway, page, heard):
    ask_for(page, "12.5")
    gateway.device.refuses[6] = 4
    page.get_by_role("button", name="Write now").click()
    page.get_by_role("heading", name="Not written").wait_for()
    del gateway.device.refuses[6]
    assert "exception 04, server device failure" in page.locator("[role=alert]").inner_text()


def test_nothing_is_written_when_nobody_says_yes(page, heard):
    ask_for(page, "12.5")
    page.get_by_role("link", name="Cancel").click()
    page.wait_for_url("**/units/press")
    assert heard() == []


def test_nothing_is_written_after_the_session_has_ended(page, heard):
    ask_for(page, "12.5")
    page.context.clear_cookies()
    page.get_by_role("button", name="Write now").click()
    page.get_by_role("heading", name="Log in first").wait_for()
    assert "Nothing was written or changed." in page.locator("main").inner_text()
    assert heard() == []


def test_nothing_is_written_with_a_forged_token(gateway, browser, heard):
    page = log_in(gateway, browser.new_page(), "anna")
    ask_for(page, "12.5")
    page.evaluate("document.querySelector('form[data-once] [name=csrf]').value = 'forged'")
    page.get_by_role("button", name="Write now").click()
    page.get_by_role("heading", name="Not allowed").wait_for()
    assert heard() == []
    page.close()


def test_a_viewer_sees_values_and_no_form_to_write(gateway, browser):
    context = browser.new_context()
    page = log_in(gateway, context.new_page(), "vera")
    assert page.locator("tr[data-point=speed]").is_visible()
    assert page.locator("form[action$='/writes']").count() == 0
    page.goto(f"{gateway.address}/images/shift")
    assert page.locator("td[data-at]").count() == 20
    assert page.locator("form[action$='/writes']").count() == 0
    context.close()


def test_points_and_values_are_read_when_somebody_asks(gateway, page):
    gateway.device.holding[0] = 77
    page.get_by_role("button", name="Read all points").click()
    value = page.locator("tr[data-point=speed] td.value")
    until(lambda: value.inner_text() == "7.7", page)
    assert "s ago" in page.locator("tr[data-point=speed] td.age").inner_text()
    page.locator("[data-read-values] [name=count]").fill("2")
    page.locator("[data-read-values]").get_by_role("button", name="Read").click()
    until(lambda: page.locator("[data-result] tbody tr").count() == 2, page)
    assert "holding 0" in page.locator("[data-result]").inner_text()
    assert "77" in page.locator("[data-result]").inner_text()


def test_an_open_page_reads_only_as_often_as_it_is_told(gateway, browser, annas):
    page = browser.new_page(**annas)
    page.goto(f"{gateway.address}/units/press")
    begin = len(gateway.device.heard)
    page.wait_for_timeout(6000)
    assert len(gateway.device.heard) == begin
    page.locator("tr[data-point=speed] input[name=value]").fill("33")
    page.locator("[data-every]").select_option("2")
    gateway.device.holding[0] = 88
    until(lambda: page.locator("tr[data-point=speed] td.value").inner_text() == "8.8", page)
    gateway.device.holding[0] = 89
    until(lambda: page.locator("tr[data-point=speed] td.value").inner_text() == "8.9", page)
    assert page.locator("tr[data-point=speed] input[name=value]").input_value() == "33"
    page.close()


#: The mark stays for 2.5 s; a busy machine may look later than that. So it is noted.
NOTE_A_MARK = """(cell) => {
    const note = () => { if (cell.classList.contains("changed")) cell.dataset.wasMarked = ""; };
    new MutationObserver(note).observe(cell, { attributes: true, attributeFilter: ["class"] });
}"""


def test_a_value_of_an_image_that_changes_is_marked(gateway, browser, annas):
    page = browser.new_page(**annas)
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(f"{gateway.address}/images/shift")
    cell = page.locator("td[data-at='5']")
    assert cell.inner_text() == "0"
    cell.evaluate(NOTE_A_MARK)
    other = browser.new_page(**annas)
    other.goto(f"{gateway.address}/images/shift")
    form = other.locator("form[action$='/writes']").last
    form.locator("[name=address]").fill("5")
    form.locator("[name=value]").fill("4711")
    form.get_by_role("button", name="Write …").click()
    other.get_by_role("button", name="Write now").click()
    page.locator("td[data-at='5'][data-was-marked]").wait_for()
    assert "4711" in cell.inner_text()
    assert cell.get_attribute("title") == "web:anna@127.0.0.1"
    until(lambda: "changed" not in (cell.get_attribute("class") or ""), page)
    assert complaints == []
    other.close()
    page.close()
