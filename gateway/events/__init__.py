"""Log events: one class for each, logged under its name in snake_case.

Events are for what is rare. What happens in every transaction is counted, by each part.
"""

from gateway.events.clients import *
from gateway.events.event import *
from gateway.events.lines import *
from gateway.events.remote import *
from gateway.events.service import *
