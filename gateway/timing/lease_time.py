"""How the time to live of a lease is divided, in shares of it (ADR 26)."""

from typing import Final

#: How long its holder counts on a renewal from the moment of sending it, guard included.
HOLDS: Final = 0.75
#: How long the others wait after the latest renewal they have seen. With LOOKS it is the whole, and a fifth more than
#: HOLDS: clocks may differ by that much.
WAITS: Final = 0.9
#: How often they look.
LOOKS: Final = 0.1
