import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve

LINE = '[[line]]\nport = "/dev/a"\n'
SITE = 'site = "plant-2"\n'
SERVERS = 'servers = ["nats://127.0.0.1:4222"]\n'


def problems(text):
    found = parse(text, "g.toml", port_trouble=lambda _: None, real_path=str).problems
    return [f"{each.severity}: {each.subject}{each.what}" for each in found]


def of_fleet(keys, before=SITE + LINE):
    return problems(f"{before}\n[fleet]\n{keys}")


def plan_of(keys, before=SITE + LINE):
    loaded = parse(f"{before}\n[fleet]\n{keys}", "g.toml")
    assert loaded.config is not None, loaded.problems
    return resolve(loaded.config)


def test_what_is_needed_is_enough():
    assert of_fleet(SERVERS) == []


def test_a_server_without_a_port_has_that_of_nats():
    servers = plan_of('servers = ["nats://[::1]", "tls://hub.example/", "tls://hub.example:802"]').fleet.servers
    assert [str(each) for each in servers] == ["nats://[::1]:4222", "tls://hub.example:4222", "tls://hub.example:802"]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ("servers = []", "fleet.servers: must be a list of servers"),
        ('servers = "nats://a"', "fleet.servers: must be a list of servers"),
        ('servers = ["hub"]', "fleet.servers: is not a valid address"),
        ('servers = ["ws://hub"]', "fleet.servers: unknown protocol ws://"),
        ('servers = ["nats://me:secret@hub"]', "fleet.servers: contains a user, which everybody"),
        ('servers = ["nats://0.0.0.0"]', "fleet.servers[0]: 0.0.0.0 is not the address of a server"),
        ('servers = ["nats://hub:0"]', "fleet.servers[0]: port 0 is not the port of a server"),
        (SERVERS + 'ca = "/ca"', "fleet.ca: is used only with tls://"),
        ('servers = ["tls://hub"]\ncertificate = "/c"', "fleet.certificate: has no effect without key"),
        (SERVERS + 'user = "a"', "fleet.user: has no effect without password"),
        (SERVERS + 'password = { file = "/p" }', "fleet.password: has no effect without user"),
        (SERVERS + 'credentials = "/c"\nuser = "a"\npassword = { file = "/p" }', "fleet.user: cannot be used together"),
        (SERVERS + 'lease = "10 ms"', "fleet.lease: "),
        (SERVERS + 'fallback = "stop"', "fleet.fallback: "),
    ],
)
def test_what_cannot_be_is_an_error_at_its_place(keys, said):
    assert [each for each in of_fleet(keys) if each.startswith(f"error: {said}")]


def test_a_login_that_everybody_can_read_on_the_way_is_a_warning():
    said = "warning: fleet.servers[0]: the connection is not encrypted"
    assert of_fleet('servers = ["nats://hub"]\ncredentials = "/c"') == [said]
    assert of_fleet('servers = ["tls://hub"]\ncredentials = "/c"') == []


@pytest.mark.parametrize("site", ["plant 2", "plant.2", "plant*", ">", "a" * 65])
def test_a_site_that_cannot_be_part_of_a_subject_is_an_error(site):
    [said] = of_fleet(SERVERS, f'site = "{site}"\n{LINE}')
    assert "cannot be the name of a site in [fleet]" in said


def test_the_fleet_needs_the_name_of_its_site():
    [said] = of_fleet(SERVERS, LINE)
    assert said.startswith("error: fleet.servers: needs the name of this gateway's site")


def test_a_lease_needs_the_fleet():
    assert problems(LINE + 'lease = "hall-a"') == ["error: line[0].lease: needs [fleet], where NATS keeps the lease"]
    assert of_fleet(SERVERS, f'{SITE}{LINE}lease = "hall-a"') == []
    assert problems(LINE + 'lease = "hall a"')[0].startswith('error: line[0].lease: "hall a" is not the name')


UPSTREAM = '[[upstream]]\nto = "{}"\nunits = [{{ as = 37, unit = 7 }}]\n'


def test_units_of_another_site_are_an_upstream():
    plan = plan_of(SERVERS, SITE + UPSTREAM.format("fleet://plant-1"))
    [upstream] = plan.upstreams
    assert upstream.port.site == "plant-1"
    assert (upstream.upstream.name, upstream.devices[0].unit, upstream.devices[0].known_as) == (
        "fleet://plant-1",
        7,
        37,
    )


@pytest.mark.parametrize(
    ("to", "fleet", "said"),
    [
        ("fleet://plant-1", "", "error: upstream[0].to: fleet://plant-1 needs [fleet]"),
        ("fleet://plant-2", f"[fleet]\n{SERVERS}", "error: upstream[0].to: leads back to this gateway"),
        ("fleet://plant.1", f"[fleet]\n{SERVERS}", 'error: upstream[0].to: "plant.1" is not the name of a site'),
    ],
)
def test_a_site_that_cannot_be_asked_is_an_error(to, fleet, said):
    assert any(each.startswith(said) for each in problems(SITE + UPSTREAM.format(to) + fleet))


LISTEN = '[[listen]]\nbind = "tcp://127.0.0.1:{}"\nsite = "{}"\n'


def test_listeners_for_a_site_need_no_upstream_and_share_the_one_that_there_is():
    plan = plan_of(SERVERS, SITE + LISTEN.format(5021, "plant-1") + LISTEN.format(5022, "plant-1"))
    assert [each.only for each in plan.listeners] == ["fleet://plant-1"] * 2
    [upstream] = plan.upstreams
    assert (upstream.port.site, len(upstream.unlisted)) == ("plant-1", 256)
    named = UPSTREAM.format("fleet://plant-1").replace("to =", 'name = "east"\nto =')
    plan = plan_of(SERVERS, SITE + LISTEN.format(5021, "plant-1") + named)
    assert [each.only for each in plan.listeners] == ["east"]
    assert [len(each.unlisted) for each in plan.upstreams] == [255]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (SITE + LISTEN.format(5021, "plant-1"), "site: fleet://plant-1 needs [fleet]"),
        (SITE + LISTEN.format(5021, "plant-2"), "site: leads back to this gateway"),
        (SITE + LISTEN.format(5021, "plant 1"), 'site: "plant 1" is not the name of a site'),
        (SITE + LINE + LISTEN.format(5021, "plant-1") + 'line = "/dev/a"\n', "site: cannot be combined with line"),
        (SITE + LISTEN.format(5021, "plant-1") + "unit0 = 1\n", "unit0: unit 0 is a unit of that server here"),
    ],
)
def test_what_does_not_fit_a_listener_for_a_site(text, said):
    assert any(each.startswith(f"error: listen[0].{said}") for each in problems(text))


def test_a_time_out_that_leaves_nothing_to_the_owner_is_a_warning():
    said = of_fleet(SERVERS, SITE + UPSTREAM.format("fleet://plant-1") + 'timeout = "200 ms"\n')
    assert [each.partition(" is ")[0] for each in said] == ["warning: upstream[0].timeout:"]


ACCESS = '[[access]]\n{}\nallow = ["read", "write"]\n'


def test_a_row_can_name_sites():
    plan = plan_of(SERVERS, SITE + LINE + ACCESS.format('listen = ["fleet"]\nfrom = ["plant-1", "plant-3"]'))
    assert plan.access[0].sites == {"plant-1", "plant-3"}


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ('from = ["plant-1"]', 'error: access[0].from[0]: "plant-1" is not a valid network'),
        ('from = ["plant-1"]\nlisten = ["fleet", "default"]', 'error: access[0].from[0]: "plant-1" is not a valid'),
        ('from = ["10.2.0.0/24"]\nlisten = ["fleet"]', 'error: access[0].from[0]: clients of "fleet" are sites'),
    ],
)
def test_sites_and_networks_are_not_mixed_up(keys, said):
    assert any(each.startswith(said) for each in of_fleet(SERVERS, SITE + LINE + ACCESS.format(keys)))


def test_a_row_behind_one_for_all_sites_never_matches():
    rows = ACCESS.format('listen = ["fleet"]') + ACCESS.format('listen = ["fleet"]\nfrom = ["plant-1"]')
    [said] = of_fleet(SERVERS, SITE + LINE + rows)
    assert "never matches" in said
    other = ACCESS.format('listen = ["fleet"]\nfrom = ["plant-3"]') + ACCESS.format(
        'listen = ["fleet"]\nfrom = ["plant-1"]'
    )
    assert of_fleet(SERVERS, SITE + LINE + other) == []


def test_a_table_that_is_there_and_wrong_is_not_asked_for():
    upstream = '[[upstream]]\nto = "fleet://plant-1"\nunits = [{ as = 9, unit = 1 }]\n'
    assert of_fleet(SERVERS + "lease = 5\n" + upstream) == ["error: fleet.lease: a duration needs a unit"]
