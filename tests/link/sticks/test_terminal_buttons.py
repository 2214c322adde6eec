"""Keys of the terminal act as a stick's buttons."""

from __future__ import annotations

import os
import pty
import termios

import pytest

from cohelm.core.types import Stick
from cohelm.link.sticks import terminal_buttons
from cohelm.link.sticks.port import Button
from cohelm.link.sticks.terminal_buttons import TerminalButtons
from tests.link.sticks.test_helm import Held


@pytest.fixture
def terminal(monkeypatch):
    monkeypatch.setattr(terminal_buttons, "foreground", lambda _: True)
    person, here = pty.openpty()
    yield person, here
    os.close(person)
    os.close(here)


def test_each_key_presses_its_button_once_and_the_terminal_is_restored(terminal):
    person, here = terminal
    before = termios.tcgetattr(here)
    stick = TerminalButtons(Held(), here)
    assert stick.listens
    assert stick.read().pressed == ()
    os.write(person, b"m rx")
    assert stick.read().pressed == (Button.MODE, Button.STOP, Button.RESET)
    assert stick.read().pressed == ()
    stick.close()
    assert termios.tcgetattr(here) == before
    os.write(person, b" ")
    assert not stick.read().pressed


def test_the_wrapped_stick_is_unchanged(terminal):
    held = Held()
    stick = TerminalButtons(held, terminal[1])
    held.stick, held.buttons = Stick(0.5, 0.25), [Button.LEASE]
    os.write(terminal[0], b"r")
    reading = stick.read()
    assert (reading.stick, reading.pressed) == (held.stick, (Button.LEASE, Button.RESET))
    assert (stick.name, stick.kind, stick.force) == (held.name, held.kind, True)


def test_without_a_terminal_only_the_stick_is_read(tmp_path):
    with (tmp_path / "no-terminal").open("w") as file:
        stick = TerminalButtons(Held(), file.fileno())
        assert not stick.listens
        assert stick.read().pressed == ()
        stick.close()


def test_with_stdin_closed_only_the_stick_is_read(monkeypatch):
    monkeypatch.setattr("sys.stdin", None)
    assert not TerminalButtons(Held()).listens


def test_in_the_background_the_terminal_is_not_read():
    person, here = pty.openpty()  # not the one this runs in
    stick = TerminalButtons(Held(), here)
    assert not stick.listens
    os.close(person)
    os.close(here)
