"""What `[web]` needs."""

import pytest

from kit.config_problems import LINE, problems


@pytest.mark.parametrize("bind", ["http://127.0.0.1:8502", "http://localhost:8502", "http://[::1]:8502"])
def test_metrics_for_this_machine_need_no_token(bind):
    assert problems(LINE + f'[web]\nbind = "{bind}"\n') == []


@pytest.mark.parametrize("bind", ["http://0.0.0.0:8502", "http://[::]:8502", "http://gw.plant:8502"])
def test_what_other_machines_can_reach_needs_users_or_a_token(bind):
    text = f'{LINE}[web]\nbind = "{bind}"\n'
    (problem,) = problems(text)
    assert problem.startswith("error: web.bind: other machines can reach it, so it needs users, or a token")
    assert problems(f'{text}token = {{ file = "t" }}\n') == []


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (
            'bind = "https://127.0.0.1:1"',
            ["error: web.bind: https:// needs certificate", "error: web.bind: https:// needs key"],
        ),
        ('bind = "https://127.0.0.1:1"\nkey = "k"', ["error: web.bind: https:// needs certificate"]),
        ('bind = "http://127.0.0.1:1"\nkey = "k"', ["error: web.key: is used only with https://"]),
        ('bind = "https://0.0.0.0:1"\nkey = { credential = "k" }\ncertificate = "c"\nusers = "u"', []),
        ('bind = "http://0.0.0.0:1"\nusers = "u"', ["warning: web.bind: passwords and tokens come in plain text"]),
        ('bind = "http://0.0.0.0:1"\nusers = "u"\nproxy = ["10.0.0.2"]', []),
        ('bind = "http://0.0.0.0:1"\nproxy = ["10.0.0.2"]', []),
        (
            'bind = "http://127.0.0.1:1"\nproxy = ["127.0.0.1"]',
            ["warning: web.proxy: every account and program on this"],
        ),
        ('bind = "http://0.0.0.0:1"\nproxy = ["::/0"]', ["warning: web.proxy: every account and program on this"]),
        ('bind = "http://127.0.0.1:1"\nwrite = true', ["error: web.write: nobody can log in, so nobody can write"]),
        ('bind = "http://127.0.0.1:1"\nwrite = true\nusers = "u"', []),
    ],
)
def test_what_the_web_page_needs(keys, said):
    found = problems(f"{LINE}[web]\n{keys}\n")
    assert len(found) == len(said)
    assert all(problem.startswith(start) for problem, start in zip(sorted(found), sorted(said), strict=True))


@pytest.mark.parametrize("key", ["{ credential = '../key' }", "{ credential = '' }", "''", "{ file = 'k' }", "7"])
def test_what_names_no_key_is_an_error(key):
    (problem,) = problems(f"{LINE}[web]\nbind = 'https://127.0.0.1:1'\ncertificate = 'c'\nkey = {key}\n")
    assert "web.key: names no file" in problem


def test_a_row_of_access_may_name_the_web_page_and_networks():
    row = '[[access]]\nlisten = ["web"]\nfrom = ["10.0.0.0/24"]\nallow = ["read"]\n'
    assert problems(LINE + row) == []


@pytest.mark.parametrize("bind", ["http://127.0.0.1:8502", "http://[::1]:8502"])
def test_the_web_page_needs_an_address_of_its_own(bind):
    host = bind.removeprefix("http://")
    text = LINE + f'[[listen]]\nbind = "tcp://{host}"\n[web]\nbind = "{bind}"\n'
    assert problems(text) == ["error: web.bind: this address is already used in gateway.toml:5"]


@pytest.mark.parametrize(
    ("listeners", "said"),
    [
        ("", ["this address is already used by the default listener"]),
        (
            '[[listen]]\nbind = "tcp://[::]:5020"\n',
            ["this address is already used in gateway.toml:5; [::] takes IPv4 clients too"],
        ),
        ('[[listen]]\nbind = "tcp://[::]:5020"\n[[listen]]\nbind = "tcp://10.0.0.1:5020"\n', []),
        ('[[listen]]\nbind = "udp://127.0.0.1:5020"\n', []),
    ],
)
def test_the_web_page_collides_with_what_takes_clients_at_its_address(listeners, said):
    found = problems(f'{LINE}{listeners}[web]\nbind = "http://127.0.0.1:5020"\n')
    assert [one for one in found if one.startswith("error")] == [f"error: web.bind: {each}" for each in said]
