"""What tables say of the four areas."""

from gateway.config.plan.points import initial_values, ranges_in
from gateway.config.schema.image import Image
from gateway.modbus.codes import Area


def test_an_image_has_its_addresses_and_its_first_values_by_area():
    image = Image.model_validate({"unit": 1, "holding": 10, "initial": {"holding": [{"at": 3, "values": [1, True]}]}})
    assert ranges_in(Area.HOLDING, image) == ((0, 9),)
    assert ranges_in(Area.COILS, image) == ()
    assert [(row.at, row.values) for row in initial_values(Area.HOLDING, image)] == [(3, (1, 1))]
