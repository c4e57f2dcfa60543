"""Answers that wait for their turn."""

from insenv.mavlink.commands import MAX_PEERS, MAX_PER_SEND, MAX_WAITING, Outbox


def test_answers_are_bounded_and_each_peer_has_its_turn():
    outbox, out = Outbox(), []
    for peer in ("a", "b"):
        for _ in range(MAX_WAITING + 50):
            outbox.put(peer, [peer])
    assert outbox.dropped == 100
    while outbox.send(lambda peer, message: out.append((peer, message))):
        assert len(out) <= 2 * MAX_WAITING
    assert out[:4] == [("a", "a"), ("b", "b")] * 2 and out.count(("a", "a")) == out.count(("b", "b")) == MAX_WAITING
    for number in range(MAX_PEERS + 10):
        outbox.put(number, [0])
    assert outbox.dropped == 110
    assert outbox.send(lambda *_: None) == MAX_PER_SEND


def test_all_parameters_requested_repeatedly_are_one_pending_list():
    outbox, out = Outbox(), []
    for _ in range(1000):
        outbox.put("a", iter(range(40)))
        outbox.put("b", iter(range(40)))
    while outbox.send(lambda peer, message: out.append(peer)):
        pass
    assert out.count("a") == out.count("b") == 40
