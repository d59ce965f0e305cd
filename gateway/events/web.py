"""The web page and its users."""

from gateway.events.event import Event, Level


class WebUp(Event):
    """The web page, the API and metrics can be reached over HTTP."""

    address: str


class WebClosed(Event):
    """Nothing can be reached over HTTP. All else works."""

    level = Level.WARNING
    address: str
    reason: str


class WebLogin(Event):
    """Somebody has logged in at the web page."""

    client: str
    user: str


class WebLoginFailed(Event):
    """Somebody has sent a wrong password to the web page; `user` is empty if there is no such user."""

    level = Level.WARNING
    client: str
    user: str


class WebUsersRejected(Event):
    """The file with the users cannot be used as it is now; those that were in it before stay."""

    level = Level.WARNING
    reason: str
