"""Turns a config into the settings of every part. The parts do not depend on the config."""

from dataclasses import replace

from gateway.config.add_ons import ADD_ONS
from gateway.config.plan.access import access_row
from gateway.config.plan.images import image_settings, mirror_settings
from gateway.config.plan.lines import line_plan, server_plan, upstream_plan
from gateway.config.plan.listeners import listen_settings
from gateway.config.plan.profiles import profile_of
from gateway.config.plan.reach import client_lines
from gateway.config.plan.settings import DEFAULT_LISTENER, LinePlan, LogSettings, Plan, UpstreamPlan
from gateway.config.plan.unit_points import own_points, points_of_units
from gateway.config.schema.config import Config
from gateway.images.self_image import self_settings
from gateway.routing.access import DEFAULT_ROWS


def resolve(config: Config) -> Plan:
    """Turn a config that has passed its checks into the settings that it asks for."""
    plan = _without_add_ons(config)
    for add_on in ADD_ONS:
        plan = add_on.add(plan, config)
    return plan


def _without_add_ons(config: Config) -> Plan:
    profiles = {name: profile_of(name, table) for name, table in config.profile.items()}
    lines = tuple(line_plan(line, profiles, config) for line in client_lines(config))
    upstreams = tuple(upstream_plan(upstream, profiles, config) for upstream in config.upstream)
    owners: tuple[LinePlan | UpstreamPlan, ...] = (*lines, *upstreams)
    devices = {device.name: device for owner in owners for device in owner.devices}
    images = tuple(image_settings(image, profiles) for image in config.image if image.of is None)
    own = () if config.own is None else (self_settings(config.own.unit, config.own.place),)
    mirrors = tuple(mirror_settings(image, devices[image.of]) for image in config.image if image.of is not None)
    behind = {device.known_as: device.profile for line in lines for device in line.shared}
    behind |= {device.known_as: device.profile for upstream in upstreams for device in upstream.devices}
    behind |= {each.unit: each.profile for each in (*images, *own, *mirrors)}
    plan = Plan(
        site=config.site,
        listeners=tuple(listen_settings(listen, config.listen) for listen in config.listen) or (DEFAULT_LISTENER,),
        lines=lines,
        servers=tuple(server_plan(line, behind) for line in config.line if line.role == "server"),
        upstreams=upstreams,
        images=(*images, *own),
        mirrors=mirrors,
        access=tuple(map(access_row, config.access)) or DEFAULT_ROWS,
        log=LogSettings(config.log.level, config.log.format),
        points={unit: points for unit, points in points_of_units(config, images, mirrors) if points},
        control=None if config.control is None else config.control.socket,
        ring=config.trace.ring,
    )
    if config.own is not None:
        plan = replace(plan, points={**plan.points, config.own.unit: own_points(plan)})
    return plan
