"""Log events: one class for each, logged under its name in snake_case.

Events are for what is rare. What happens in every transaction is counted, in the `Counts` of each part.
"""

from gateway.events.event import *
from gateway.events.fleet import *
from gateway.events.lines import *
from gateway.events.listeners import *
from gateway.events.plant import *
from gateway.events.routing import *
from gateway.events.service import *
from gateway.events.web import *
