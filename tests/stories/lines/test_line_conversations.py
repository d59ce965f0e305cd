"""The rules of one line, as conversations that do not know its inside; each file beside this one is a topic."""

from pathlib import Path

import pytest

from kit.conversation import Conversation, conversations
from kit.line_stage import LineStage

FILES = sorted(Path(__file__).parent.glob("*.conversations"))


@pytest.mark.parametrize(
    "conversation",
    [each for file in FILES for each in conversations(file)],
    ids=lambda conversation: conversation.title,
)
def test_a_line_keeps_its_rules(conversation: Conversation) -> None:
    LineStage(conversation).play()


def test_no_title_stands_twice() -> None:
    titles = [each.title for file in FILES for each in conversations(file)]
    assert sorted(titles) == sorted(set(titles))
