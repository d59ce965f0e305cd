"""Who takes up a line's time: a bounded table by client, unit and function, for the time since it was taken last."""

from typing import Final

#: Rows of the table. What further clients, units and functions take goes to one row for all of them.
MOST_ROWS: Final = 64
#: Who stands in that row.
OTHERS: Final = "others"

#: Client, unit identifier on the wire, function.
User = tuple[str, int, int]


class Use:
    """What somebody has taken: seconds, and transactions."""

    __slots__ = ("seconds", "transactions")

    def __init__(self) -> None:
        self.seconds = 0.0
        self.transactions = 0

    def add(self, seconds: float, transactions: int = 1) -> None:
        """Add some more."""
        self.seconds += seconds
        self.transactions += transactions


class Usage:
    """Adds up what each user takes of a line. `take` it now and then: the table then begins anew."""

    __slots__ = ("_clients", "_size")

    def __init__(self) -> None:
        #: By client, unit and function: three look-ups cost less than one that has to put all three together.
        self._clients: dict[str, dict[int, dict[int, Use]]] = {}
        self._size = 0

    def add(self, client: str, unit: int, function: int, seconds: float) -> None:
        """Add how long a transaction of this user has taken the line, with the silence behind it."""
        of_client = self._clients.get(client)
        of_unit = None if of_client is None else of_client.get(unit)
        use = None if of_unit is None else of_unit.get(function)
        if use is None:
            use = self._new(client, unit, function)
        use.add(seconds)

    def take(self) -> dict[User, Use]:
        """Take all that was added since the last time."""
        rows = self.look()
        self._clients, self._size = {}, 0
        return rows

    def look(self) -> dict[User, Use]:
        """Return the same, while the table goes on."""
        return {
            (client, unit, function): use
            for client, of_client in self._clients.items()
            for unit, of_unit in of_client.items()
            for function, use in of_unit.items()
        }

    def _new(self, client: str, unit: int, function: int) -> Use:
        if self._size >= MOST_ROWS:
            client, unit, function = OTHERS, 0, 0
        of_unit = self._clients.setdefault(client, {}).setdefault(unit, {})
        if function not in of_unit:
            of_unit[function] = Use()
            self._size += 1
        return of_unit[function]
