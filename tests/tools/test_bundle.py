"""A bundle is bounded, and has no secret in any of its documents."""

from gateway.operator.operations.answers.support import Document
from gateway.tools.bundle import MOST_OF_ALL, MOST_OF_ONE, Bundle
from kit.bundles import documents_in


def packed(bundle, secrets=()):
    return documents_in(bundle.packed(secrets, "gw-1", 1_777_636_800.0))


def test_parts_of_a_document_are_joined_and_what_is_missing_is_told_with_its_reason():
    bundle = Bundle()
    bundle.add_all([Document("a.txt", "one "), Document("a.txt", "two"), Document("b.txt", missing="no such file")])
    documents = packed(bundle)
    assert documents["a.txt"] == "one two"
    assert "b.txt" not in documents
    assert "b.txt: missing: no such file" in documents["README.txt"]
    assert "2026-05-01T12:00:00Z on gw-1" in documents["README.txt"]


def test_it_says_whether_it_has_values_of_the_process():
    bundle = Bundle()
    assert "no values of the process" in packed(bundle)["README.txt"]
    bundle.add(Document("trace.jsonl", "{}"))
    assert "with the values of the process (trace.jsonl)" in packed(bundle)["README.txt"]


def test_secrets_are_hidden_in_every_document_however_they_are_written():
    bundle = Bundle()
    secret = 'ge"heim\u00fc'
    bundle.add(Document("log.txt", f"login with {secret} failed"))
    bundle.add(Document("a.json", '{"a": "ge\\"heim\\u00fc", "b": "ge\\"heim\u00fc"}'))
    bundle.add(Document("parts.txt", "ge"))
    bundle.add(Document("parts.txt", '"heim\u00fc'))
    for name, text in packed(bundle, {secret}).items():
        assert "heim" not in text, name


def test_a_secret_of_several_lines_and_one_between_two_parts_are_hidden():
    bundle = Bundle()
    long = "x" * (64 * 1024 - 3) + "geheim-1\n" + "y" * 70_000 + " geheim-2\n"
    bundle.add(Document("a.txt", long + "begin\nline-geheim\nend"))
    text = packed(bundle, {"geheim-1", "geheim-2", "begin\nline-geheim\n"})["a.txt"]
    assert "geheim" not in text
    assert len(text) > 100_000


def test_a_short_secret_does_not_make_holes_in_other_words():
    bundle = Bundle()
    bundle.add(Document("log.txt", "a line is up"))
    assert packed(bundle, {"a"})["log.txt"] == "a line is up"


def test_a_document_has_a_bound_and_so_has_the_whole():
    bundle = Bundle()
    for number in range(6):
        for _ in range(10):
            bundle.add(Document(f"{number}.txt", "x" * (MOST_OF_ONE // 4)))
    documents = packed(bundle)
    assert documents["0.txt"].endswith("the bundle has room for no more]\n")
    assert sum(map(len, documents.values())) < MOST_OF_ALL + 10_000
    assert len(documents["0.txt"]) < MOST_OF_ONE + 100
