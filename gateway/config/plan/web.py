"""What `[web]` asks for: where pages and API are, and who is let in."""

from dataclasses import replace

from gateway.config.plan.settings import Plan, WebPlan
from gateway.config.schema.config import Config
from gateway.config.schema.web import Web
from gateway.tls.settings import ServerTls


def add_web(plan: Plan, config: Config) -> Plan:
    """Add the settings of the web page and its API to a plan, if the config asks for them."""
    return plan if config.web is None else replace(plan, web=_web(config.web))


def _web(web: Web) -> WebPlan:
    return WebPlan(
        bind=web.bind,
        hosts=web.hosts,
        token=web.token,
        users=web.users,
        tls=None if web.certificate is None or web.key is None else ServerTls(web.certificate, web.key),
        source=web.place,
        proxy=web.proxy or (),
        write=web.write,
        history=web.history,
        values=web.values,
    )
