"""The settings of virtual units, and their points."""

from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final
import re

from gateway.config.plan.images import image_settings
from gateway.config.plan.map_place import MapTarget
from gateway.config.plan.map_rows import planned_rows
from gateway.config.plan.map_sources import MapSource
from gateway.config.plan.unit_points import points_in
from gateway.config.schema.config import Config
from gateway.config.schema.image import Image
from gateway.config.values.names import LONGEST_NAME
from gateway.config.values.ranges import join_ranges
from gateway.images.virtual.settings import FreshBits, MappedValue, SourceAge, VirtualSettings
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span
from gateway.profiles.point import Point
from gateway.profiles.profile import Profile, Range
from gateway.registers.items import REGISTER, has_bits
