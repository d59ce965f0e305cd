"""What operations remember of the running gateway."""

from gateway.operator.operator import Operator, until_reload
from kit.asking import NO_FILE
from kit.gateway_bench import gateway_bench

CONFIG = '[[image]]\nunit = 200\nname = "shift"\nholding = 2\n'


async def test_what_was_made_is_remembered_until_a_reload() -> None:
    made = []

    @until_reload
    def units(operator: Operator) -> list[str]:
        made.append("units")
        return [each.name for each in operator.gateway.plan.images]

    async with gateway_bench(CONFIG) as bench:
        operator = Operator(bench.running, NO_FILE)
        assert units(operator) is units(operator)
        assert made == ["units"]
        await bench.reload(CONFIG.replace("shift", "night"))
        assert units(operator) == units(operator) == ["night"]
        assert made == ["units"] * 2
