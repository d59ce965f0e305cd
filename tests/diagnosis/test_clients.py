"""Clients whose time-out is too short."""

from dataclasses import replace

from gateway.diagnosis.clients import about_client
from gateway.diagnosis.evidence import ClientEvidence
from gateway.diagnosis.last import Last

CLIENT = ClientEvidence("10.2.0.7", "scada", left=12, waited=0.5, longest_wait=3.42)


def test_a_client_that_leaves_again_and_again_needs_a_longer_time_out():
    (row,) = about_client(CLIENT)
    assert (row.level, row.about) == ("fix", "client 10.2.0.7 of scada")
    assert row.what == "closed its connection 12 times before its response came, the last time after 500 ms"
    assert row.remedy == "set the time-out of this client above 3.5 s"


def test_leaving_once_or_after_the_longest_wait_needs_nothing():
    assert not list(about_client(replace(CLIENT, left=2)))
    (row,) = about_client(replace(CLIENT, waited=5.0))
    assert row.level == "note"


def test_a_client_that_leaves_at_once_was_ended_and_has_not_timed_out():
    (row,) = about_client(replace(CLIENT, waited=0.032))
    assert (row.level, row.remedy) == ("note", "")


def test_a_client_that_left_long_ago_may_have_another_time_out_now():
    (row,) = about_client(replace(CLIENT, last=Last(720.0)))
    assert (row.level, row.what.partition("the last time ")[2]) == ("note", "after 500 ms, the last one 12 min ago")
