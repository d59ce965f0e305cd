"""A read over HTTP that takes several requests is of one unit, also when a reload leads its number elsewhere."""

import asyncio

from kit.browser import web_bench
from kit.device import SimulatedDevice, SimulatedLine

CONFIG = """
[[line]]
name = "hall"
port = "/dev/hall"

[[line.devices]]
unit = 1
as = 41
name = "press"
points = [{ name = "start", coils = 0 }, { name = "speed", holding = 0 }]
"""
OTHER = (
    CONFIG.replace("as = 41", "as = 43")
    + """
[[image]]
unit = 41
name = "other"
holding = 20
coils = 8
initial.holding = [{ at = 0, values = [777] }]
"""
)


async def test_no_value_of_another_unit_is_told_as_one_of_this_unit(tmp_path):
    async with web_bench(CONFIG, tmp_path) as bench:
        bench.inner.attach("hall", SimulatedLine("rtu", SimulatedDevice(1, delay=0.3)))
        anna = bench.browser()
        await anna.log_in("anna")
        reading = asyncio.create_task(bench.browser().get("/api/v1/units/press/points"))
        await asyncio.sleep(0.1)
        (tmp_path / "gateway.toml").write_text(OTHER)
        assert (await anna.post("/api/v1/reload")).status == 200
        page = await reading
        assert 777 not in [each["value"] for each in page.json.get("values", ())]
