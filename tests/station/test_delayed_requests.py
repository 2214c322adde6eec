"""The age of a request counts from the press of the button."""

import time
from types import SimpleNamespace

import pytest

from cohelm.link.messages import RequestKind
from cohelm.station.messages import Do, from_page
from cohelm.station.operator import PageOperator


@pytest.mark.parametrize("late", [0.0, 0.4, 5.0])
def test_a_request_delayed_in_transit_is_not_executed(late):
    asked = []
    link = SimpleNamespace(ask=lambda *request: asked.append(request) or 1)
    operator = PageOperator("key", "anna", link, 0.25)
    pressed = time.monotonic() - late
    operator._on_message(from_page(Do(what="automatic", echo_ms=pressed * 1e3).model_dump_json()))
    (what, _, made), *more = asked
    assert (what, more) == (RequestKind.MODE, [])
    assert made == pytest.approx(pressed, abs=1e-6)
