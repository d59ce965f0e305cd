"""Listeners for another site: each gets the upstream that leads there."""

from gateway.config.schema.config import Config
from gateway.config.schema.listen import Listen
from gateway.config.schema.upstream import Upstream
from gateway.config.values.site import Site


def with_sites(config: Config) -> Config:
    """Make listeners for a site listeners for the upstream to it, which is added if the file does not have it."""
    if not config.listen:
        return config
    upstreams = list(config.upstream)
    listeners = tuple(_for_upstream(listen, upstreams) for listen in config.listen)
    return config.model_copy(update={"listen": listeners, "upstream": tuple(upstreams)})


def _for_upstream(listen: Listen, upstreams: list[Upstream]) -> Listen:
    if listen.site is None or listen.line is not None or listen.upstream is not None:
        return listen
    site = Site(listen.site)
    there = next((upstream for upstream in upstreams if site in upstream.to), None)
    if there is None:
        there = Upstream.model_validate({"to": str(site)}).placed(listen.path, listen.place)
        upstreams.append(there)
    return listen.model_copy(update={"site": None, "upstream": there.label})
