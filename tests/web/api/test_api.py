"""The HTTP API: values, errors and what a request may cost. In virtual time, without sockets."""

import asyncio
import json

import pytest

from gateway.operator.values.unit_values import MOST_ITEMS
from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 6, as = 46, name = "press", points = [
  { name = "speed", holding = 0, type = "int32", swap = "words", scale = 0.1, unit = "rpm", write = true },
  { name = "state", holding = 2, labels = { 0 = "off", 1 = "running" }, write = true },
  { name = "count", holding = 3 },
  { name = "gone", holding = 900 },
  { name = "start", coils = 0, write = "only" },
] }]

[[image]]
unit = 200
name = "shift <b>"
holding = 3000
coils = 16

[[image]]
unit = 201
profile = "several"
holding = 10

[profile.several]
functions = [3, 16]
limits = { 16 = 2 }
"""
UNITS = "/api/v1/units"


@pytest.fixture
async def bench(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(6)))
        yield bench


@pytest.fixture
async def anna(bench):
    browser = bench.browser()
    await browser.log_in("anna")
    return browser


async def test_a_device_is_read_by_number_and_by_name(bench):
    page = await bench.browser().get(f"{UNITS}/46/holding/0-1")
    assert page.json["elapsed_ms"] > 0
    assert page.json == {
        "unit": 46,
        "name": "press",
        "area": "holding",
        "values": [
            {"address": 0, "reference": "40001", "value": 0, "registers": [0]},
            {"address": 1, "reference": "40002", "value": 0, "registers": [0]},
        ],
        "elapsed_ms": page.json["elapsed_ms"],
    }
    assert (await bench.browser().get(f"{UNITS}/press/holding/0")).json["values"][0]["value"] == 0


async def test_values_are_written_and_read_with_type_and_swap(anna):
    page = await anna.put(f"{UNITS}/200/holding/10-13?type=int32&swap=words", [-2, 70000])
    assert [each["registers"] for each in page.json["values"]] == [[65534, 65535], [4464, 1]]
    page = await anna.get(f"{UNITS}/200/holding/10-13?type=int32&swap=words")
    assert [each["value"] for each in page.json["values"]] == [-2, 70000]
    assert (await anna.get(f"{UNITS}/200/holding/10?type=int32&swap=words")).json["values"][0]["value"] == -2


async def test_coils_take_truth_values_and_words(anna):
    assert (await anna.put(f"{UNITS}/200/coils/0-3", [True, False, 1, "on"])).status == 200
    assert [each["value"] for each in (await anna.get(f"{UNITS}/200/coils/0-3")).json["values"]] == [1, 0, 1, 1]


async def test_text_fills_its_registers(anna):
    await anna.put(f"{UNITS}/200/holding/20-24?type=string", ["Größe"])
    assert (await anna.get(f"{UNITS}/200/holding/20-24?type=string")).json["values"][0]["value"] == "Größe"


async def test_points_are_read_and_written_by_name(anna):
    page = await anna.put(f"{UNITS}/press/points/speed", [12.5])
    assert page.json["values"] == [
        {
            "point": "speed",
            "area": "holding",
            "address": 0,
            "reference": "40001",
            "value": 12.5,
            "unit": "rpm",
            "registers": [125, 0],
        }
    ]
    assert (await anna.get(f"{UNITS}/press/points/speed")).json["values"][0]["value"] == 12.5
    assert (await anna.put(f"{UNITS}/press/points/state", ["running"])).status == 200
    assert (await anna.get(f"{UNITS}/46/points/state")).json["values"][0]["value"] == "running"


async def test_points_side_by_side_are_written_with_one_request(bench, anna):
    page = await anna.put(
        f"{UNITS}/press/points", [{"point": "state", "value": "running"}, {"point": "speed", "value": 1}]
    )
    assert page.status == 200
    (audit,) = bench.events("write_audit")
    assert (audit.function, audit.address, audit.count) == (16, 0, 3)
    page = await anna.put(f"{UNITS}/press/points", [{"point": "start", "value": 1}, {"point": "speed", "value": 1}])
    assert "side by side" in page.problem
    assert len(bench.events("write_audit")) == 1


async def test_of_all_points_those_that_fail_are_named(bench):
    page = await bench.browser().get(f"{UNITS}/press/points")
    assert page.status == 200
    assert [each["point"] for each in page.json["values"]] == ["speed", "state", "count"]
    (failure,) = page.json["errors"]
    assert (failure["address"], failure["exception"]) == (900, 2)


async def test_a_unit_is_shown_with_its_points_and_status(bench):
    unit = (await bench.browser().get(f"{UNITS}/46")).json
    assert [point["name"] for point in unit["points"]] == ["speed", "state", "count", "gone", "start"]
    assert unit["status"]["line"] == "hall"
    units = (await bench.browser().get(UNITS)).json["units"]
    assert [each["unit"] for each in units] == [46, 200, 201]


async def test_lines_are_shown_by_name(bench):
    assert (await bench.browser().get("/api/v1/lines/hall")).json["state"] == "up"
    assert [line["name"] for line in (await bench.browser().get("/api/v1/lines")).json["lines"]] == ["hall"]


@pytest.mark.parametrize(
    ("path", "status", "exception", "result"),
    [
        (f"{UNITS}/99/holding/0", 502, 10, "no_route"),
        (f"{UNITS}/200/holding/2999-3000", 422, 2, "refused"),
        (f"{UNITS}/201/input/0", 403, 1, "refused"),
        (f"{UNITS}/46/points/gone", 422, 2, None),
        (f"{UNITS}/press/holding/0", 504, 11, "timeout"),
    ],
)
async def test_exceptions_are_problems_with_their_code(bench, path, status, exception, result):
    if status == 504:
        bench.inner.lines["hall"].on_write = lambda data: None
    page = await bench.browser().get(path)
    assert page.status == status
    assert f"exception {exception:02X}" in page.problem
    assert (page.json["exception"], page.json.get("result")) == (exception, result)


async def test_a_line_that_is_down_is_a_problem_at_once(bench):
    bench.inner.lines["hall"].pull()
    page = await bench.browser().get(f"{UNITS}/press/holding/0")
    assert (page.status, page.json["exception"], page.json["result"]) == (502, 10, "line_down")


async def test_a_busy_line_is_a_problem_that_passes(bench):
    bench.inner.lines["hall"].on_write = lambda data: None
    asked = [
        bench.browser().get(f"{UNITS}/press/{area}/{at}") for area in ("holding", "input", "coils") for at in range(40)
    ]
    pages = await asyncio.gather(*asked)
    assert {(page.status, page.json["exception"]) for page in pages} >= {(503, 6), (504, 11)}


@pytest.mark.parametrize(
    ("path", "status"),
    [
        (f"{UNITS}/nobody", 404),
        (f"{UNITS}/99", 404),
        (f"{UNITS}/256/holding/0", 404),
        (f"{UNITS}/press/points/nothing", 404),
        (f"{UNITS}/46/tables/0", 404),
        (f"{UNITS}/46/holding/x", 404),
        ("/api/v1/lines/nothing", 404),
        (f"{UNITS}/46/holding/2-1", 400),
        (f"{UNITS}/46/holding/0-65536", 400),
        (f"{UNITS}/200/holding/0-{MOST_ITEMS}", 400),
        (f"{UNITS}/200/holding/0-2?type=int32", 400),
        (f"{UNITS}/200/holding/0?type=int33", 400),
        (f"{UNITS}/200/holding/0?type=bit", 400),
        (f"{UNITS}/200/coils/0?type=uint16", 400),
        (f"{UNITS}/200/coils/0?swap=words", 400),
        (f"{UNITS}/200/holding/0?swap=sideways", 400),
        (f"{UNITS}/200/holding/0?typ=int16", 400),
        (f"{UNITS}/press/points/start", 422),
    ],
)
async def test_what_makes_no_sense_is_refused(bench, path, status):
    page = await bench.browser().get(path)
    assert page.status == status
    assert page.problem
    assert bench.events("request_refused") == []


@pytest.mark.parametrize(
    ("path", "said"),
    [
        (f"{UNITS}/200/holding/0?type=int33", '"type" must be one of uint16, int16, '),
        (f"{UNITS}/200/holding/0?swap=sideways", '"swap" must be one of none, words, bytes, both; '),
        (f"{UNITS}/200/holding/0?end=3", "end: there are only type and swap"),
        ("/api/v1/trace.pcapng?per_second=3", "per_second: there are only line, unit, "),
    ],
)
async def test_a_refusal_says_what_there_is(bench, path, said):
    page = await bench.browser().get(path)
    assert (page.status, page.problem[: len(said)]) == (400, said)


async def test_a_value_that_is_none_is_called_as_in_json(anna):
    page = await anna.put(f"{UNITS}/200/holding/0", [None])
    assert page.problem == "expected a number, boolean or string, got null"


@pytest.mark.parametrize(
    ("path", "values", "status"),
    [
        ("200/holding/0", [65536], 422),
        ("200/holding/0", [1.5], 422),
        ("200/holding/0", ["x"], 422),
        ("200/holding/0", [None], 422),
        ("200/holding/0", [[1]], 422),
        ("200/holding/0", [float("nan")], 400),
        ("200/holding/0", [], 400),
        ("200/holding/0", [1, 2], 400),
        ("200/holding/0", {"0": 1}, 400),
        ("200/holding/0-199", [0] * 200, 422),
        ("200/input/0", [1], 422),
        ("201/holding/0-2", [1, 2, 3], 422),
        ("press/points/count", [1], 422),
        ("press/points/speed", [1, 2], 400),
        ("press/points/speed", ["fast"], 422),
        ("press/points", [1], 400),
        ("press/points", [{"point": "nothing", "value": 1}], 404),
        ("press/points", [{"point": "speed", "value": 1}, {"point": "speed", "value": 2}], 422),
    ],
)
async def test_what_cannot_be_written_is_not_sent(bench, anna, path, values, status):
    page = await anna.put(f"{UNITS}/{path}", values)
    assert page.status == status
    assert page.problem
    assert bench.events("write_audit") == []


@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("points/speed", [7]),
        ("points", [{"point": "speed", "value": 7}]),
        ("holding/0-1?type=int32&swap=words", [70]),
    ],
)
async def test_who_has_written_does_not_get_what_was_read_before(anna, path, values):
    before = (await anna.get(f"{UNITS}/press/points")).json["values"][0]
    assert (await anna.put(f"{UNITS}/press/{path}", values)).status == 200
    after = (await anna.get(f"{UNITS}/press/points?max_age=60")).json["values"][0]
    assert (before["value"], after["value"]) == (0, 7)


@pytest.mark.parametrize("value", ["1e400", '"nan"', '"1_000"', '"\u0661"'])
async def test_a_value_that_is_no_finite_number_is_not_sent(bench, anna, value):
    headers = {"Origin": f"http://{anna.name}", "X-CSRF-Token": anna.csrf, "Content-Type": "application/json"}
    body = f'{{"values": [{value}]}}'.encode()
    assert (await anna.ask("PUT", f"{UNITS}/200/holding/0-1?type=float32", body, headers)).status == 422
    assert bench.events("write_audit") == []


@pytest.mark.parametrize(
    "body", [b"", b"{", b"[1]", b'{"values": [1], "more": 1}', b"[" * 10_000, b'{"values": [' + b"9" * 5000 + b"]}"]
)
async def test_a_body_that_is_no_question_is_refused(bench, anna, body):
    headers = {"Origin": f"http://{anna.name}", "X-CSRF-Token": anna.csrf, "Content-Type": "application/json"}
    assert (await anna.ask("PUT", f"{UNITS}/200/holding/0", body, headers)).status == 400
    headers["Content-Type"] = "text/plain"
    assert (await anna.ask("PUT", f"{UNITS}/200/holding/0", b'{"values": [1]}', headers)).status == 415
    assert bench.events("write_audit") == []


async def test_a_large_body_is_refused(anna):
    assert (await anna.put(f"{UNITS}/200/holding/0", ["x" * 40_000])).status == 413


async def test_a_unit_that_knows_16_only_gets_that(bench, anna):
    assert (await anna.put(f"{UNITS}/201/holding/0", [5])).status == 200
    assert bench.events("write_audit")[0].function == 16


async def test_what_waits_of_a_browser_that_has_left_is_not_written(bench, anna):
    """The line is busy with a request that is not answered; the browser closes the connection meanwhile."""
    sent = []
    bench.inner.lines["hall"].on_write = sent.append
    first = asyncio.create_task(bench.browser().get(f"{UNITS}/press/holding/0"))
    await asyncio.sleep(0.1)
    body = json.dumps({"values": [1]}).encode()
    head = {"Origin": f"http://{anna.name}", "X-CSRF-Token": anna.csrf, "Content-Type": "application/json"}
    wire = anna.open(f"{UNITS}/press/holding/0", method="PUT", body=body, headers=head)
    await asyncio.sleep(0.1)
    wire.close()
    await first
    await asyncio.sleep(10)
    assert [data[1] for data in sent] == [3]
    assert [event.result for event in bench.events("write_audit")] == ["unwanted"]


async def test_a_reload_applies_the_file_or_says_why_not(bench, anna, tmp_path):
    (tmp_path / "gateway.toml").write_text(CONFIG.replace('"hall"', '"yard"'))
    page = await anna.post("/api/v1/reload")
    assert (page.status, page.json["added"], page.json["removed"]) == (200, ["line yard"], ["line hall"])
    (tmp_path / "gateway.toml").write_text("line = 3\n")
    page = await anna.post("/api/v1/reload")
    assert page.status == 422
    assert page.json["problems"] == [page.problem]


async def test_many_readers_of_the_status_cost_one(bench):
    pages = [await bench.browser().get("/api/v1/status") for _ in range(20)]
    assert len({page.json["at"] for page in pages}) == 1
    await asyncio.sleep(1.0)
    assert (await bench.browser().get("/api/v1/status")).json["at"] >= pages[0].json["at"] + 1.0
