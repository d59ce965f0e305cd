"""Turns a config into the settings of every part. The parts do not depend on the config."""

from dataclasses import replace
from functools import cached_property

from gateway.config.add_ons import ADD_ONS
from gateway.config.plan.access import access_row, listen_settings
from gateway.config.plan.images import OWN_VALUES, image_settings, kind_of, mirror_settings
from gateway.config.plan.lines import line_plan, monitor_plan, server_plan, upstream_plan
from gateway.config.plan.profiles import guarded_profile_of
from gateway.config.plan.reach import client_lines, monitor_lines
from gateway.config.plan.settings import DEFAULT_LISTENER, LogSettings, OwnerPlan, Plan
from gateway.config.plan.unit_points import own_points, points_of_devices, points_of_profiles, points_of_units
from gateway.config.plan.virtual import Maps, map_target
from gateway.config.schema.config import Config
from gateway.images.self_image import self_settings
from gateway.routing.access import DEFAULT_ROWS


class Planning:
    """The settings that a config asks for, in two steps, each made once, and when it is asked for."""

    def __init__(self, config: Config) -> None:
        self.config = config

    @cached_property
    def maps(self) -> Maps:
        """The plan of all that the rows of virtual units need, and these rows. The config has passed its checks."""
        return _without_rows(self.config)

    @cached_property
    def plan(self) -> Plan:
        """The plan with virtual units and add-ons. The rows of virtual units have passed their checks, too."""
        plan = self.maps.added_to(self.maps.plan)
        for add_on in ADD_ONS:
            plan = add_on.add(plan, self.config)
        return plan


def resolve(config: Config) -> Plan:
    """Turn a config that has passed its checks into the settings that it asks for."""
    return Planning(config).plan


def _without_rows(config: Config) -> Maps:
    """Plan all that the rows of virtual units need, and nothing that needs them."""
    profiles = {name: guarded_profile_of(name, table) for name, table in config.profile.items()}
    lines = tuple(line_plan(line, profiles, config) for line in client_lines(config))
    upstreams = tuple(upstream_plan(upstream, profiles, config) for upstream in config.upstream)
    monitors = tuple(monitor_plan(line, profiles, config) for line in monitor_lines(config))
    owners: tuple[OwnerPlan, ...] = (*lines, *upstreams, *monitors)
    devices = {device.name: device for owner in owners for device in owner.devices}
    images = tuple(image_settings(image, profiles) for image in config.image if kind_of(image) in OWN_VALUES)
    own = () if config.own is None else (self_settings(config.own.unit, config.own.place),)
    of_profile = points_of_profiles(config)
    of_devices = tuple(points_of_devices(config, of_profile))
    heard = {device.name for monitor in monitors for device in monitor.devices}
    points_heard = {device.name: device.points for device in of_devices if device.name in heard}
    mirrors = tuple(
        mirror_settings(image, devices[image.of], points_heard.get(image.of))
        for image in config.image
        if image.of is not None
    )
    behind = {device.known_as: device.profile for line in lines for device in line.shared}
    behind |= {device.known_as: device.profile for part in owners[len(lines) :] for device in part.devices}
    behind |= {each.unit: each.profile for each in (*images, *own, *mirrors)}
    behind |= {image.unit: profiles[image.profile] for image in config.image if kind_of(image) == "virtual unit"}
    plan = Plan(
        site=config.site,
        listeners=(DEFAULT_LISTENER,)
        if config.listens_by_default
        else tuple(listen_settings(listen, config.listen) for listen in config.listen),
        lines=lines,
        servers=tuple(server_plan(line, behind) for line in config.line if line.role == "server"),
        upstreams=upstreams,
        monitors=monitors,
        images=(*images, *own),
        mirrors=mirrors,
        access=tuple(map(access_row, config.access)) or DEFAULT_ROWS,
        log=LogSettings(config.log.level, config.log.format),
        points={unit: points for unit, points in points_of_units(of_devices, images, mirrors, of_profile) if points},
        control=None if config.control is None else config.control.socket,
        ring=config.trace.ring,
    )
    if config.own is not None:
        plan = replace(plan, points={**plan.points, config.own.unit: own_points(plan)})
    targets = (map_target(image, profiles, of_profile) for image in config.image if kind_of(image) == "virtual unit")
    return Maps(plan, of_devices, tuple(targets))
