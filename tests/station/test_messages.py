from pathlib import Path

import pytest
from pydantic import ValidationError

from cohelm.link.messages import Localised
from cohelm.station import typescript, view
from cohelm.station.messages import Stick, from_page
from tests.link.ends import STATUS

WEB = Path(__file__).parents[2] / "src" / "cohelm" / "station" / "web" / "src"


def test_the_pages_types_are_those_of_the_server() -> None:
    made = (WEB / "messages.ts").read_text(encoding="utf-8")
    assert made == typescript.text(), "run: python -m cohelm.station.typescript > .../messages.ts"


@pytest.mark.parametrize(
    "text",
    [
        "", "[]", "null", "{}", '{"type":"stick"}',
        '{"type":"dance"}', '{"type":"do","what":"fly"}',
        '{"type":"do","what":"give","value":-1}', '{"type":"do","what":"give","value":1.5}',
        '{"type":"waypoints","points":[],"only_check":true}',
        '{"type":"waypoints","points":[[NaN,0]],"only_check":true}',
        '{"type":"waypoints","points":[[1e9,0]],"only_check":true}',
        '{"type":"got","stream":"map"}', '{"type":"play","playing":true,"speed":0}',
    ],
)  # fmt: skip
def test_malformed_messages_are_refused(text: str) -> None:
    with pytest.raises(ValidationError):
        from_page(text)


def test_a_deflection_beyond_the_stick_is_refused() -> None:
    good = Stick(n=1, echo_ms=0.0, x=1.0, psi=-1.0, valid=True, armed=True, device="touch",
                 speed_scale=1.0)  # fmt: skip
    assert from_page(good.model_dump_json()) == good
    for x in ("1.001", "-2", "NaN", "Infinity", "1e400", '"1"', "null"):
        with pytest.raises(ValidationError):
            from_page(good.model_dump_json().replace('"x":1.0', f'"x":{x}'))


def test_without_localization_no_standard_deviation_is_shown() -> None:
    on_a_map = STATUS._replace(localised=Localised.GOOD, sigma=0.02)
    assert view.state(on_a_map, 1.0, 0.01).sigma_m == pytest.approx(0.02)
    for nobody in (Localised.UNKNOWN, Localised.LOST):
        assert view.state(on_a_map._replace(localised=nobody), 1.0, 0.01).sigma_m is None
