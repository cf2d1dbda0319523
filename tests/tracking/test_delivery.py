"""A thread that delivers in order, while the receiver comes and goes."""

from __future__ import annotations

from threading import Event

import pytest

from tracking.mlflow import delivery
from tracking.mlflow.delivery import Away, Delivery


class Receiver:
    """Takes entries; is away for the first `failures` calls; refuses what is in `bad`."""

    def __init__(self, failures=0, bad=()):
        self.failures = failures
        self.bad = set(bad)
        self.calls: list[int] = []
        self.got: list[int] = []
        self.told: list[str] = []
        self.here = Event()
        self.here.set()

    def send(self, entry):
        assert self.here.wait(60)
        self.calls.append(entry)
        if self.failures:
            self.failures -= 1
            raise Away("no route")
        if entry in self.bad:
            raise ValueError(f"{entry} is bad")
        self.got.append(entry)

    def delivery(self):
        return Delivery(
            self.send,
            lambda entry, error: self.told.append(f"refused {entry}: {error}"),
            lambda reason: self.told.append(f"away: {reason}"),
            lambda: self.told.append("back"),
        )


@pytest.fixture(autouse=True)
def short_pauses(monkeypatch):
    monkeypatch.setattr(delivery, "FIRST_PAUSE_S", 0.001)
    monkeypatch.setattr(delivery, "LONGEST_PAUSE_S", 0.01)


def delivered(receiver, entries=range(5), reason=None):
    sender = receiver.delivery()
    sender.start(reason)
    for entry in entries:
        sender.put(entry)
    sender.finish(60)
    assert len(sender) == 0
    return receiver


def test_entries_arrive_in_order():
    receiver = delivered(Receiver())
    assert receiver.got == receiver.calls == [0, 1, 2, 3, 4]
    assert receiver.told == []


def test_what_was_put_before_the_start_comes_first():
    receiver = Receiver()
    sender = receiver.delivery()
    sender.put(7)
    sender.start()
    sender.put(8)
    sender.finish(60)
    assert receiver.got == [7, 8]


def test_a_receiver_that_goes_away_gets_the_same_entry_again_and_is_told_of_once():
    receiver = delivered(Receiver(failures=6))
    assert receiver.calls == [0] * 6 + [0, 1, 2, 3, 4]
    assert receiver.got == [0, 1, 2, 3, 4]
    assert receiver.told == ["away: no route", "back"]


def test_a_receiver_found_away_is_told_of_before_anything_is_sent():
    receiver = delivered(Receiver(failures=1), reason=Away("refused"))
    assert receiver.told == ["away: refused", "back"]


def test_an_entry_that_is_refused_does_not_hold_up_the_rest():
    receiver = delivered(Receiver(bad={1, 3}))
    assert receiver.got == [0, 2, 4]
    assert receiver.told == ["refused 1: 1 is bad", "refused 3: 3 is bad"]


def test_put_does_not_wait():
    receiver = Receiver()
    receiver.here.clear()
    sender = receiver.delivery()
    sender.start()
    for entry in range(100):
        sender.put(entry)
    assert len(sender) == 100
    receiver.here.set()
    sender.finish(60)
    assert receiver.got == list(range(100))


@pytest.mark.parametrize("failures", [10**9, 0])
def test_the_end_gives_up_a_receiver_that_is_away_or_does_not_answer(failures):
    receiver = Receiver(failures)
    if not failures:
        receiver.here.clear()
    sender = receiver.delivery()
    sender.start()
    for entry in range(3):
        sender.put(entry)
    sender.finish(0.05)
    assert len(sender) == 3
    receiver.failures = 0
    receiver.here.set()
    sender._thread.join(60)
    assert not sender._thread.is_alive()
    assert receiver.got in ([], [0])  # at most what was on its way


def test_the_end_waits_as_long_as_something_arrives():
    receiver = Receiver()
    slow = Event()
    send = receiver.send

    def slowly(entry):
        slow.wait(0.3)
        send(entry)

    receiver.send = slowly
    sender = receiver.delivery()
    sender.start()
    for entry in range(8):
        sender.put(entry)
    sender.finish(2)  # less than all of them take
    assert receiver.got == list(range(8))
    assert len(sender) == 0


def test_pauses_grow_to_a_limit(monkeypatch):
    receiver = Receiver(failures=6)
    pauses = []
    monkeypatch.setattr(Delivery, "_rest", lambda self, seconds: pauses.append(seconds))
    delivered(receiver)
    assert pauses == [0.001, 0.002, 0.004, 0.008, 0.01, 0.01]
