"""Prometheus as operators install it: it takes the metrics, the rules and the dashboard's queries, and scrapes."""

import json
import re
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote
from urllib.request import urlopen

import pytest

from gateway.runtime.fleet.metrics import metrics_of_sites
from kit.free_port import free_port
from kit.process import PATIENCE, GatewayProcess
from kit.sites import site

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
RULES = DEPLOY / "prometheus/modbus-gateway-alerts.yml"
DASHBOARD = DEPLOY / "grafana/modbus-gateway.json"
CONFIG = """
site = "plant"

[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:0"

[[line]]
name = "hall-a"
port = "{folder}/absent"
devices = [{{ unit = 1, name = "silo", points = [{{ name = "weight", holding = 0 }}] }}]

[[image]]
unit = 200
holding = 1

[web]
bind = "http://127.0.0.1:{port}"

[mqtt]
broker  = "mqtt://127.0.0.1:1"
publish = [{{ device = "silo", every = "1 s" }}]
keep    = "1 MiB"
"""

pytestmark = pytest.mark.needs("promtool")


def promtool(*words: str | Path, given: str = "", folder: Path | None = None) -> None:
    done = subprocess.run(["promtool", *words], input=given, capture_output=True, text=True, cwd=folder, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout


def expressions() -> list[str]:
    """What the dashboard asks for, with its variables filled in."""
    board = json.loads(DASHBOARD.read_text(encoding="utf-8"))
    asked = [target["expr"] for panel in board["panels"] for target in panel["targets"]]
    filled = (("$__rate_interval", "1m"), ("$instance", ".*"), ("$line", ".*"))
    for name, value in filled:
        asked = [each.replace(name, value) for each in asked]
    return asked


def names(text: str) -> set[str]:
    """The metrics of this project that a text asks for, without the endings of histograms."""
    return {re.sub(r"_bucket$", "", name) for name in re.findall(r"modbus_gateway_\w+", text)}


def get(url: str) -> Any:
    with urlopen(url, timeout=PATIENCE) as response:
        return json.load(response)["data"]


def until(url: str, is_there) -> Any:
    """What is found there, once it is."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        try:
            found = get(url)
        except OSError:  # it does not listen yet
            found = None
        if found is not None and is_there(found):
            return found
        time.sleep(0.2)
    raise AssertionError(f"not found: {url}: {found}")


def alerts(found: Any) -> set[str]:
    """Their names. A busy machine scrapes too late once in a while, and then the gateway is slow or seems away."""
    return {alert["labels"]["alertname"] for alert in found["alerts"]}


def test_the_rules_fire_for_what_they_are_for_and_not_before(tmp_path):
    shutil.copy(RULES, tmp_path)
    shutil.copy(Path(__file__).with_name("alerts_test.yml"), tmp_path)
    promtool("check", "rules", RULES)
    promtool("test", "rules", "alerts_test.yml", folder=tmp_path)


def test_every_rule_has_a_test():
    rules = re.findall(r"alert: (\w+)", RULES.read_text(encoding="utf-8"))
    tested = Path(__file__).with_name("alerts_test.yml").read_text(encoding="utf-8")
    assert [rule for rule in rules if f"alertname: {rule}" not in tested] == []


def test_a_real_prometheus_scrapes_evaluates_the_rules_and_understands_the_dashboard(tmp_path):
    web, prometheus = free_port(), free_port()
    shutil.copy(RULES, tmp_path)
    settings = (DEPLOY / "prometheus/prometheus.yml").read_text(encoding="utf-8")
    settings = settings.replace("127.0.0.1:8502", f"127.0.0.1:{web}").replace(
        "scrape_interval: 15s", "scrape_interval: 1s"
    )
    (tmp_path / "prometheus.yml").write_text(f"global: {{ evaluation_interval: 1s }}\n{settings}")
    promtool("check", "config", tmp_path / "prometheus.yml")
    with GatewayProcess(tmp_path, CONFIG.format(folder=tmp_path, port=web)):
        with urlopen(f"http://127.0.0.1:{web}/metrics", timeout=PATIENCE) as response:
            metrics = response.read().decode()
        promtool("check", "metrics", given=metrics)
        words = [
            "prometheus",
            f"--config.file={tmp_path / 'prometheus.yml'}",
            f"--storage.tsdb.path={tmp_path / 'data'}",
        ]
        log = (tmp_path / "prometheus.log").open("w")
        process = subprocess.Popen([*words, f"--web.listen-address=127.0.0.1:{prometheus}"], stderr=log, stdout=log)
        try:
            api = f"http://127.0.0.1:{prometheus}/api/v1"
            (line,) = until(f"{api}/query?query=modbus_gateway_line_up", lambda found: found["result"])["result"]
            assert (line["metric"]["line"], line["value"][1]) == ("hall-a", "0")
            until(f"{api}/alerts", lambda found: alerts(found) - {"ModbusGatewaySlow"} == {"ModbusLineDown"})
            for expression in expressions():
                get(f"{api}/query?query={quote(expression)}")
        finally:
            process.kill()
            process.wait()
            log.close()
    told = {name.removesuffix(" ") for name in re.findall(r"^# TYPE (\S+)", metrics, re.MULTILINE)}
    told |= {f"modbus_gateway_{each.name}" for each in metrics_of_sites([site("plant-7")])}  # NATS is not there
    assert names(" ".join([*expressions(), RULES.read_text(encoding="utf-8")])) - told == set()
