from cohelm.station.operator import CREDIT, Outbox


def test_a_newer_message_replaces_an_older_one_that_was_not_sent() -> None:
    box = Outbox()
    box.put("who", "old")
    box.put("alarms", "none")
    box.put("who", "new")
    assert box.take() == ["new", "none"]
    assert box.take() == []


def test_a_stream_pauses_while_the_page_is_hidden_and_resumes_with_the_newest() -> None:
    box = Outbox()
    sent: list[str | bytes] = []
    for n in range(10):
        box.put("frame", f"{n}")
        sent += box.take()
    assert sent == [str(n) for n in range(CREDIT["frame"])]
    box.credit("frame")
    assert box.take() == ["9"]


def test_credit_does_not_accumulate() -> None:
    box = Outbox()
    for _ in range(100):
        box.credit("frame")
    sent: list[str | bytes] = []
    for n in range(10):
        box.put("frame", f"{n}")
        sent += box.take()
    assert len(sent) == CREDIT["frame"]


def test_unchanged_messages_are_not_sent_again() -> None:
    box = Outbox()
    box.put("who", "a", changed_only=True)
    assert box.take() == ["a"]
    box.put("who", "a", changed_only=True)
    assert box.take() == []
    box.put("who", "b", changed_only=True)
    box.put("who", "a", changed_only=True)
    assert box.take() == ["a"]
