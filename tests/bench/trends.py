"""What trends cost: processor time to sample values, and bytes on the disk.

    python -m tests.bench.trends            for 100 and 1000 points
    python -m tests.bench.trends 5000       for so many

A day is played in a few seconds: each point has a value a second, which is what costs the processor most. Bytes are
those that the kernel has counted for this process (`write_bytes`, in /var/tmp), and what the pages of the file take.
"""

import math
import random
import sys
import tempfile
import time
from pathlib import Path

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.operator.trends.numbers import Read
from gateway.operator.trends.table import TABLE, write
from gateway.operator.trends.trends import Trends, key_of
from gateway.profiles.point import Point
from gateway.state.database import open_table
from gateway.timing.trend import Layout

NOON = 1_777_636_800


def written() -> int:
    """Read how many bytes this process has had written to disks."""
    rows = Path("/proc/self/io").read_text().splitlines()
    return next(int(row.split()[1]) for row in rows if row.startswith("write_bytes"))


def sampling(points: int) -> float:
    """Measure the processor time that one value takes, in microseconds: half of them are scaled, half floats."""
    trends = Trends(Layout.of(86400))
    kinds = [("int16", 1, 0.1), ("float32", 2, 1.0)]
    rows = [
        Point(f"p{at}", Area.HOLDING, 2 * at, kind, "none", count, scale, 1 if scale < 1 else None)
        for at in range(points)
        for kind, count, scale in (kinds[at % 2],)
    ]
    blocks = [rows[at : at + 60] for at in range(0, points, 60)]
    reads = []
    for block in blocks:
        first = block[0].address
        span = Span(Area.HOLDING, first, 120)
        reads.append((Read.of(span, block), [key_of("hall", 1, "meter", point) for point in block]))
    responses = [bytes((3, 240)) + random.randbytes(240) for _ in range(10)]
    begun = time.process_time()
    for second in range(120):
        for _ in trends.at(NOON + second):
            pass
        for read, keys in reads:
            for key, number in zip(keys, read.numbers(responses[second % 10]), strict=True):
                if number is not None:
                    trends.add(key, number)
    return (time.process_time() - begun) / 120 / points * 1e6


def day_on_disk(points: int, kept: float, share_changing: float, hours: int) -> tuple[float, float, float]:
    """Write trends of so many hours; return bytes in an hour, bytes of the file, and processor time per write."""
    layout = Layout.of(kept)
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        opened = open_table(Path(folder) / "trends.sqlite", TABLE)
        trends, before, spent = Trends(layout), 0, 0.0
        keys = [random.randrange(-(2**63), 2**63) for _ in range(points)]
        for minute in range(60 * hours):
            if minute == 60 * (hours - 6):
                before = written()
            for _ in trends.at(NOON + 60 * minute + 1):
                pass
            if minute % 10 == 0 and (pieces := trends.changes().written):
                begun = time.process_time()
                write(opened.database, layout, pieces, trends.time)
                spent += time.process_time() - begun
            for at, key in enumerate(keys):
                is_changing = at < share_changing * points
                trends.add(key, 4999.66)
                if is_changing:
                    for _ in range(3):
                        trends.add(key, 5000 + 100 * math.sin(minute / 30 + at) + random.random())
        size = opened.database.size
        opened.database.close()
        return (written() - before) / 6, size, spent / (6 * hours)


def main() -> None:
    """Print a table."""
    for points in [int(each) for each in sys.argv[1:]] or [100, 1000]:
        print(f"{points} points: {sampling(points):.1f} us of the processor for a value")
        for name, kept in (("24 h", 86400.0), ("7 days", 604800.0)):
            for share in (1.0, 0.3):
                hourly, size, spent = day_on_disk(points, kept, share, 30)
                print(
                    f"  {name}, {share:.0%} of them changing: {hourly / 2**20:.2f} MiB an hour written, "
                    f"{size / 2**20:.1f} MiB in 30 h, room for {Layout.of(kept).points}, {1000 * spent:.0f} ms a write"
                )


if __name__ == "__main__":
    main()
