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
        """Some more."""
        self.seconds += seconds
        self.transactions += transactions


class Usage:
    """Adds up what each user takes of a line. `take` it now and then: the table then begins anew."""

    __slots__ = ("_rows",)

    def __init__(self) -> None:
        self._rows: dict[User, Use] = {}

    def add(self, client: str, unit: int, function: int, seconds: float) -> None:
        """A transaction of this user has taken the line so long, with the silence behind it."""
        user = (client, unit, function)
        use = self._rows.get(user)
        if use is None:
            use = self._new(user)
        use.add(seconds)

    def take(self) -> dict[User, Use]:
        """All that was added since the last time."""
        rows, self._rows = self._rows, {}
        return rows

    def look(self) -> dict[User, Use]:
        """The same, and the table goes on."""
        return self._rows

    def _new(self, user: User) -> Use:
        if len(self._rows) >= MOST_ROWS:
            user = (OTHERS, 0, 0)
        return self._rows.setdefault(user, Use())
