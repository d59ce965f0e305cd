"""The page on which a line is prepared: port, scan, names and profiles, and the text to add. It writes nothing."""

import asyncio
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

from aiohttp import web

from gateway.clock.threads import in_thread
from gateway.config.problem import WrongValue
from gateway.config.values.port import fits_mode, parse_format
from gateway.config.values.unitset import parse_units, show_units
from gateway.errors import Unready, WrongQuestion
from gateway.hardware.listing import ListedPort, list_serial_ports
from gateway.operator.config.check import TextChecks
from gateway.operator.operations.answers.scan import Found
from gateway.operator.units.units import find_line, units_of
from gateway.readconfig.text_check import TextProblem
from gateway.timing.characters import LineTiming, Mode
from gateway.tools.page_scans import LIKELY, PageScan, PortToScan
from gateway.tools.scan import RATES
from gateway.tools.scans import check_may_scan
from gateway.tools.search import FORMATS
from gateway.web.access.guard import VISITOR
from gateway.web.api.asking import asker_for, asker_of
from gateway.web.front.problems import ProblemError
from gateway.web.front.turns import Turns
from gateway.web.pages.addresses import see_other
from gateway.web.pages.new_line import (
    MOST_DEVICES,
    Addition,
    NewDevice,
    commands_to_append,
    commands_to_edit,
    line_text,
    points_of,
    profile_names,
    proposals,
    propose_line_name,
    with_devices,
    with_line,
)
from gateway.web.pages.page import Page, Shown, route

#: The rates of the form, and its formats.
_RATES: Final = sorted(RATES)
_FORMATS: Final = ("8E1", "8N1", "8O1", "8N2", "7E1", "7O1", "7N2")
#: How long a list of the ports is shown to others too, in seconds: it looks at all programs.
PORTS_KEPT: Final = 3.0
_BAUD: Final = re.compile(r"[1-9][0-9]{1,7}")
_NUMBER: Final = re.compile(r"[0-9]{1,3}")


class AddLinePage(Page):
    """The handlers of `/config/line`."""

    def __init__(self, shown: Shown) -> None:
        super().__init__(shown)
        self._turns = Turns()
        self._listed_ports: Sequence[tuple[ListedPort, str]] = ()
        self._listed_at: float | None = None

    @route("GET", "/config/line")
    async def show(self, request: web.Request) -> web.Response:
        """Show the ports, or the settings of a scan if the address names a port or a line."""
        port, line = request.query.get("port", ""), request.query.get("line", "")
        if line:
            find_line(self._operator.gateway, line)
        ports = () if line else await self._ports(request)
        if port and port not in (each.path for each, _ in ports):
            raise ProblemError(404, f"this machine has no serial port {port}")
        return await self._renderer.page(
            "add_line.html",
            request,
            port=port,
            line=line,
            ports=ports,
            lines=[each.name for each in self._operator.gateway.lines],
            rates=_RATES,
            formats=_FORMATS,
            likely=show_units(LIKELY),
            last=self._scans.last_of(request[VISITOR].csrf),
            current=self._scans.current,
        )

    @route("POST", "/config/line/scans", "operator")
    async def scan(self, request: web.Request) -> web.Response:
        """Start the scan that a form asks for.

        Raises:
            ProblemError: a field is invalid, or the port cannot be scanned.
            WrongQuestion: the visitor may not read every unit, or there is no such line.
        """
        form, visitor = await _form(request), request[VISITOR]
        check_may_scan(self._operator.running, asker_of(request))
        units = _units(form.get("units", ""))
        try:
            if form.get("line"):
                find_line(self._operator.gateway, form["line"])
                asker = asker_for(visitor, lambda: True)
                begun = self._scans.start_on_line(form["line"], asker, units, visitor.user, visitor.csrf)
            else:
                wanted = await self._port_to_scan(request, form, units)
                begun = self._scans.start_on_port(wanted, visitor.user, visitor.csrf)
        except WrongQuestion as wrong:
            raise ProblemError(409, str(wrong)) from wrong
        return see_other(f"/config/line/scans/{begun.identifier}")

    @route("GET", "/config/line/scans/{id}")
    async def follow(self, request: web.Request) -> web.Response:
        """Show how far a scan is; in the end, a form with the units that were found."""
        found = self._scans.find(request.match_info["id"], request[VISITOR].csrf)
        if found is None:
            raise ProblemError(404, "there is no such scan any longer; begin again at /config/line")
        if found.ended is None:
            return await self._renderer.page("line_scan.html", request, scan=found)
        return await self._devices(request, found.found or (), _settings_of(found), found)

    @route("POST", "/config/line/scans/{id}", "operator")
    async def end(self, request: web.Request) -> web.Response:
        """End a scan."""
        found = self._scans.find(request.match_info["id"], request[VISITOR].csrf)
        if found is not None:
            self._scans.end(found, f"ended by {request[VISITOR].user}")
        return see_other(request.path)

    @route("GET", "/config/line/devices")
    async def name(self, request: web.Request) -> web.Response:
        """Show the form with units that the address names, without a scan."""
        query = request.query
        settings = {key: query.get(key, "") for key in ("port", "line", "mode", "baud", "format", "role")}
        if settings["port"]:
            _timing(settings)
        units = _units(query.get("units", ""))
        if len(units) > MOST_DEVICES:
            raise ProblemError(422, f"units: {len(units)} are too many for a form; name {MOST_DEVICES} at most")
        return await self._devices(request, [Found(unit, "answers") for unit in units], settings, None)

    async def _devices(
        self, request: web.Request, found: Sequence[Found], settings: Mapping[str, str], scan: PageScan | None
    ) -> web.Response:
        plan, file, text = self._operator.gateway.plan, self._operator.reloader.file, self._operator.reloader.text
        owners = plan.owners
        passing = {line.name for line in plan.lines if line.passes_through}
        units = [each.unit for each in units_of(self._operator) if each.unit is not None and each.kind != "device"]
        units += [each.known_as for owner in owners if owner.name not in passing for each in owner.devices]
        names = [each.name for each in units_of(self._operator)]
        lines = [line.name for line in (*owners, *(each.line for each in plan.servers))]
        return await self._renderer.page(
            "line_devices.html",
            request,
            in_thread=lambda: {"profiles": profile_names(file, text)},
            scan=scan,
            settings=settings,
            name=propose_line_name(lines),
            proposed=list(proposals(found[:MOST_DEVICES], units, names)),
            more=max(0, len(found) - MOST_DEVICES),
        )

    @route("POST", "/config/line/text", "operator")
    async def write(self, request: web.Request) -> web.Response:
        """Show the text to add, what `check` says of it, and the commands.

        Raises:
            ProblemError: a field is invalid, or no device is chosen.
            Unready: too many other texts are being checked; or the config comes from a program.
        """
        form, reloader = await _form(request), self._operator.reloader
        if reloader.fixed:
            raise Unready(reloader.fixed)
        devices = _devices_in(form)
        if not devices:
            raise ProblemError(422, "no unit is chosen")
        line, file = form.get("line", ""), reloader.file.absolute()
        place = next((each.plan.line.source for each in self._operator.gateway.lines if each.name == line), "")
        if line:
            find_line(self._operator.gateway, line)
            new = with_devices(reloader.text, line, devices)
            if new is None:
                raise ProblemError(409, f"{file} does not have the line {line} any longer as it is in use")
            edited = file.parent / (place.rpartition(":")[0] or file.name)
            commands = commands_to_edit(edited, is_service=reloader.is_service)
        else:
            timing, name = _timing(form), form.get("name", "").strip()
            port, only_listens = form.get("port", ""), form.get("role") == "monitor"
            added = line_text(name, port, timing, devices, only_listens=only_listens)
            new = with_line(reloader.text, added)
            commands = commands_to_append(file, added, is_service=reloader.is_service)
        is_there = asker_of(request).is_there
        checked = await self._operator.kept(TextChecks).check(self._operator, new.whole, is_there)
        kinds = sorted({each.profile for each in devices})
        return await self._renderer.page(
            "line_text.html",
            request,
            in_thread=lambda: {"points": {each: points_of(each, file, reloader.text) for each in kinds}},
            line=line,
            place=place,
            file=file,
            new=new,
            commands=commands,
            **_sorted(checked.problems, new),
        )

    @route("GET", "/config/line/text")
    async def begin_anew(self, _request: web.Request) -> web.Response:
        """Lead who comes without a form, as by the link to another language, to the first step."""
        return see_other("/config/line")

    async def _ports(self, request: web.Request) -> Sequence[tuple[ListedPort, str]]:
        """List the ports of this machine, each with the line that has it, if one does; of PORTS_KEPT ago at most."""
        async with self._turns.turn(request):
            loop = asyncio.get_running_loop()
            if self._listed_at is None or loop.time() - self._listed_at > PORTS_KEPT:
                self._listed_ports = await in_thread("web ports", self._listed)
                self._listed_at = loop.time()
            return self._listed_ports

    def _listed(self) -> Sequence[tuple[ListedPort, str]]:
        return [(each, self._scans.line_at(each.path)) for each in list_serial_ports()]

    async def _port_to_scan(self, request: web.Request, form: Mapping[str, str], units: tuple[int, ...]) -> PortToScan:
        """Make what a form asks to scan: one of the ports that this machine lists, which nobody uses."""
        port = form.get("port", "")
        listed = next((each for each, _ in await self._ports(request) if each.path == port), None)
        if listed is None:
            raise ProblemError(404, f"this machine has no serial port {port}")
        if listed.state == "in use":
            raise ProblemError(409, f"{port} is in use {listed.remark}")
        is_known = bool(form.get("baud"))
        return PortToScan(port, _timing(form), is_known, units)


async def _form(request: web.Request) -> dict[str, str]:
    return {name: str(text) for name, text in (await request.post()).items()}


def _units(text: str) -> tuple[int, ...]:
    try:
        return parse_units([part.strip() for part in text.split(",")], first=1)
    except WrongValue as wrong:
        raise ProblemError(422, f"units: {wrong}" + (f"; {wrong.remedy}" if wrong.remedy else "")) from wrong


def _timing(form: Mapping[str, str]) -> LineTiming:
    """Read rate and format of a form; without a rate they are the first usual ones.

    Raises:
        ProblemError: one of them is invalid, or does not fit the mode.
    """
    mode: Mode = "ascii" if form.get("mode") == "ascii" else "rtu"
    baud = form.get("baud", "")
    if not baud:
        return LineTiming(mode, RATES[0], FORMATS[mode][0])
    if not _BAUD.fullmatch(baud):
        raise ProblemError(422, f'baud: "{baud}" is no rate; write a number such as 9600')
    try:
        format_ = parse_format(form.get("format") or str(FORMATS[mode][0]))
    except WrongValue as wrong:
        raise ProblemError(422, f"format: {wrong}; {wrong.remedy}") from wrong
    if not fits_mode(format_, mode):
        raise ProblemError(422, f"format: RTU needs 8 data bits, and {format_} has {format_.data_bits}")
    return LineTiming(mode, int(baud), format_)


def _settings_of(scan: PageScan) -> dict[str, str]:
    speed = scan.speed
    at = {"baud": str(speed.baud), "format": str(speed.format)} if speed else {"baud": "", "format": ""}
    return {"port": "" if scan.is_line else scan.of, "line": scan.of if scan.is_line else "", "mode": scan.mode, **at}


def _devices_in(form: Mapping[str, str]) -> list[NewDevice]:
    """Read the devices that are chosen in a form: `take-5` is set, with `as-5`, `name-5` and `profile-5`."""
    units = [name.removeprefix("take-") for name in form if name.startswith("take-")]
    if len(units) > MOST_DEVICES or not all(map(_NUMBER.fullmatch, units)):
        raise ProblemError(422, f"the form has a unit that is none, or more than {MOST_DEVICES}")
    devices = []
    for unit in units:
        known_as = form.get(f"as-{unit}", "").strip() or unit
        if not _NUMBER.fullmatch(known_as):
            raise ProblemError(422, f'unit {unit}: "{known_as}" is no number for clients; write one from 1 to 255')
        profile = form.get(f"profile-{unit}") or "generic"
        devices.append(NewDevice(int(unit), int(known_as), form.get(f"name-{unit}", "").strip(), profile))
    return devices


def _sorted(problems: Sequence[TextProblem], new: Addition) -> dict[str, Any]:
    """Sort problems into those of the text to add, by its lines, errors of the rest, and whether there is an error."""
    lines = range(new.before + 1, new.before + new.added.count("\n") + 1)
    own = [(each.line - new.before, each) for each in problems if each.line in lines and not each.file]
    others = [each for each in problems if each.severity == "error" and each not in (one for _, one in own)]
    has_errors = bool(others) or any(each.severity == "error" for _, each in own)
    return {"own": own, "others": others, "has_errors": has_errors}
