"""The page on which units of a line are searched for and written as text, in a real browser."""

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from kit.browser import PASSWORD, USERS
from kit.chromium import NEEDS_BROWSER, axe_findings
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

[web]
bind = "http://127.0.0.1:0"
users = "{folder}/users"
"""


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimpleNamespace]:
    """A gateway whose config has one of two devices."""
    folder = tmp_path_factory.mktemp("gateway")
    (folder / "users").write_text(USERS)
    (folder / "users").chmod(0o600)
    process = GatewayProcess(folder, CONFIG.format(folder=Path(folder)), level="info")
    port = VirtualPort(folder / "hall")
    devices = {port: SimulatedLine("rtu", SimulatedDevice(1), SimulatedDevice(4))}
    with port, SerialDevices(devices), process as running:
        (address,) = (event["address"] for event in running.log if event["event"] == "web_up")
        yield SimpleNamespace(address=address)


@pytest.mark.parametrize("has_scripts", [True, False], ids=["with-javascript", "without-javascript"])
def test_from_the_page_of_a_line_to_the_text_that_adds_its_unit(gateway: SimpleNamespace, browser: Any, has_scripts):
    context = browser.new_context(java_script_enabled=has_scripts)
    page = context.new_page()
    page.goto(f"{gateway.address}/login?next=/lines/hall")
    page.fill("#user", "anna")
    page.fill("#password", PASSWORD)
    page.click("form.login button")
    page.get_by_role("link", name="Search for more units").click()
    page.locator("form[action='/config/line/scans'] input[name=units]").fill("1-12")
    page.get_by_role("button", name="Search", exact=True).click()
    page.wait_for_selector("progress, .devices")
    if has_scripts:
        assert axe_findings(page) == []
    page.wait_for_selector(".devices", timeout=1000 * PATIENCE)  # the page renews itself
    assert page.get_by_role("checkbox").count() == 1
    page.locator("input[name=name-4]").fill("oven")
    if has_scripts:
        assert axe_findings(page) == []
    page.get_by_role("button", name="Make the text").click()
    text = page.locator("pre").first.inner_text()
    assert text.split() == ["[[line.devices]]", "unit", "=", "4", "name", "=", '"oven"']
    assert "no errors, no warnings" in page.locator("main").inner_text()
    if has_scripts:
        assert axe_findings(page) == []
    context.close()
