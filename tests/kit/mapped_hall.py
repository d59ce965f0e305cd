"""A virtual unit `block` over three meters on two lines; the second takes writes. Times are virtual."""

from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench

CONFIG = """
[profile.meter]
timeout = "200 ms"
points = [
  { name = "power", holding = 0, type = "int16", scale = 0.1, unit = "kW", invalid = 0x8000 },
  { name = "mode", holding = 8, labels = { 0 = "off", 1 = "run" }, write = true },
]

[[line]]
name = "hall"
port = "/dev/hall"
devices = [{ unit = 1, as = 41, name = "meter-1", profile = "meter" }, { unit = 2, as = 42, name = "meter-2" }]

[[line]]
name = "yard"
port = "/dev/yard"
devices = [{ unit = 3, as = 43, name = "meter-3", profile = "meter" }]

[[image]]
unit = 240
name = "block"
stale = "3 s"
holding = "200-209"
map = [
  { at = 0, device = "meter-1", point = "power", every = "1 s" },
  { at = 1, device = "meter-3", point = "power", type = "float32", every = "1 s" },
  { at = 3, device = "meter-1", point = "mode", every = "1 s", write = true },
  { at = 20, device = "meter-2", holding = "100-103", every = "1 s", write = true },
  { at = 90, fresh = ["meter-1", "meter-2", "meter-3"] },
  { at = 91, age = "meter-2" },
]
"""


def attach(bench: GatewayBench) -> dict[str, SimulatedDevice]:
    """Connect the meters; by their names."""
    meters = {f"meter-{unit}": SimulatedDevice(unit) for unit in (1, 2, 3)}
    bench.attach("hall", SimulatedLine("rtu", meters["meter-1"], meters["meter-2"]))
    bench.attach("yard", SimulatedLine("rtu", meters["meter-3"]))
    return meters
