"""What is wrong with a release, and what is not there."""


class Findings:
    """Collects them; each is printed at once."""

    def __init__(self) -> None:
        self.wrong: list[str] = []
        self.absent: list[str] = []

    def expect(self, is_right: object, what: str) -> None:
        """Note what is wrong."""
        if not is_right:
            print("WRONG:", what)
            self.wrong.append(what)

    def miss(self, what: str) -> None:
        """Note what is not there."""
        print("absent:", what)
        self.absent.append(what)
