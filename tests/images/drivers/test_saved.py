"""What the saved values of images take on the disk."""

from gateway.images.drivers.saved import Values, open_saved
from gateway.modbus.codes import Area
from gateway.state.page_log import LONGEST

ADDRESSES = 65536


def test_forty_full_images_have_room(tmp_path) -> None:
    values = {Area.COILS: 1, Area.DISCRETE: 1, Area.INPUT: 65535, Area.HOLDING: 65535}
    full: Values = {("shift-data", area): dict.fromkeys(range(ADDRESSES), value) for area, value in values.items()}
    saved = open_saved(tmp_path).saved
    saved.write(full, {})
    saved.close()
    assert 40 * (tmp_path / "images.snapshot").stat().st_size <= LONGEST
