"""What `profile NAME --csv` writes, `import csv` reads as the same points: of each shipped profile."""

import csv
import io

import pytest

from gateway.config.documents.points import points_csv
from gateway.config.importing.from_csv.profile import profile_from_csv
from gateway.config.load import parse
from gateway.config.plan.points import points_of
from gateway.config.reading.profile_file import shipped_profile
from gateway.profiles import shipped_names


@pytest.mark.parametrize("delimiter", [",", ";"])
@pytest.mark.parametrize("name", [each for each in shipped_names() if shipped_profile(each).table.points])
def test_a_shipped_profile_as_csv_is_read_as_the_same_points(name, delimiter):
    kind = shipped_profile(name).table
    sheet = points_csv(kind)
    if delimiter == ";":  # as a spreadsheet saves it where numbers have a comma
        sheet = _with_semicolons(sheet)
    profile = profile_from_csv(f"{name}.csv", "kind", sheet.encode("utf-8-sig"), lambda text: parse(text).problems)
    assert profile.left_out == ()
    assert profile.notes == ()
    loaded = parse(f'{profile.text}\n[[line]]\nport = "/dev/ttyS0"\n', port_trouble=lambda _: None)
    points = loaded.config.profile["kind"].points
    assert points_of(points, kind) == points_of(kind.points, kind)


def _with_semicolons(sheet):
    rows = csv.reader(io.StringIO(sheet))
    out = io.StringIO()
    csv.writer(out, delimiter=";").writerows(rows)
    return out.getvalue()
