"""What the gateway of a site may publish and hear at a NATS server, and the names that the server has for it there.

The buckets are in an account of their own. Every account has JetStream's own subjects already, and they lead to its
own JetStream; so a mapping renames them, and an import with the new name leads to the account of the buckets.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from gateway.fleet.subjects import LEASES, STATUS, all_answers, answer_folder, clock_subject

#: Buckets, by the first part of the names that their subjects have in the accounts of sites.
BUCKETS: Final[Mapping[str, str]] = {"status": STATUS, "lease": LEASES}

INFO: Final = "$JS.API.STREAM.INFO.KV_"
READ: Final = "$JS.API.STREAM.MSG.GET.KV_"
MAKE: Final = "$JS.API.STREAM.CREATE.KV_"
#: What a site may ask JetStream about a bucket, by the last part of its name in the accounts of sites.
_QUESTIONS: Final[Mapping[str, str]] = {"info": INFO, "read": READ}


def exports(site: str) -> tuple[str, ...]:
    """List the subjects that a site may publish to others: requests, answers and its heartbeat."""
    return (f"mbgw.*.unit.*.from.{site}", f"{answer_folder('*', site)}>", clock_subject(site))


def hears(site: str) -> tuple[str, ...]:
    """List the subjects to which a site may subscribe."""
    return (f"mbgw.{site}.unit.*.from.*", all_answers(site), clock_subject("*"), f"_INBOX.{site}.>")


def from_asker(owner: str, asker: str) -> str:
    """Give what the site `owner` takes from one that may ask it."""
    return f"mbgw.{owner}.unit.*.from.{asker}"


def from_owner(asker: str, owner: str) -> tuple[str, ...]:
    """List what the site `asker` takes from one that it may ask."""
    return (f"{answer_folder(asker, owner)}>", clock_subject(owner))


def entry(bucket: str, key: str) -> str:
    """Give the subject on which the entry for a key is written."""
    return f"$KV.{BUCKETS[bucket]}.{key}"


def renamed(buckets: Iterable[str], *, may_make: bool = False) -> Iterator[tuple[str, str]]:
    """List what a site may ask about these buckets: subjects of JetStream, each with its name in the site's account."""
    questions = {**_QUESTIONS, "make": MAKE} if may_make else _QUESTIONS
    for bucket in buckets:
        for verb, prefix in questions.items():
            yield f"{prefix}{BUCKETS[bucket]}", f"{bucket}.{verb}"
