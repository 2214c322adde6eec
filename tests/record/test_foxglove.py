"""The layouts of docs/ show what there is in a record: every topic and field they name is there."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from tests.ports.adapters import recorded as drive
from tests.record.runs import lab, recorded as run

DOCS = Path(__file__).parents[2] / "docs"
TYPES = {
    "3D": {"MarkerArray", "Path", "OccupancyGrid", "LaserScan"},
    "Image": {"CompressedImage"},
    "Plot": {"Status", "Period"},
    "StateTransitions": {"Status", "Period"},
    "DiagnosticSummary": {"DiagnosticArray"},
    "RosOut": {"Log"},
}


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Of each kind of record: topic -> its type and one of its messages."""
    folder = tmp_path_factory.mktemp("records")
    run(folder / "run.mcap", lab(duration=0.5))
    drive(folder / "drive.mcap", 1.0)
    found = {}
    for kind in ("run", "drive"):
        with (folder / f"{kind}.mcap").open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            found[kind] = {
                channel.topic: (schema.name.split("/")[-1], message)
                for schema, channel, _, message in reader.iter_decoded_messages()
            }
    return found


def named(panel: str, settings: dict) -> set[str]:
    """Topics and paths of a panel, as `/topic` or `/topic.field`."""
    match panel.partition("!")[0]:
        case "3D":
            return set(settings["topics"])
        case "Image":
            return {settings["imageMode"]["imageTopic"]}
        case "Plot" | "StateTransitions":
            return {path["value"] for path in settings["paths"]}
        case _:
            return {settings["topicToRender"]}


@pytest.mark.parametrize("kind", ["run", "drive"])
def test_a_layout_names_only_what_a_record_holds(kind, messages):
    layout = json.loads((DOCS / f"foxglove-{kind}.json").read_text())
    for panel, settings in layout["configById"].items():
        assert named(panel, settings)
        for path in named(panel, settings):
            topic, _, field = path.partition(".")
            form, message = messages[kind][topic]
            assert form in TYPES[panel.partition("!")[0]], path
            assert not field or isinstance(getattr(message, field), float | int | bool), path


@pytest.mark.parametrize("kind", ["run", "drive"])
def test_a_layout_places_every_panel_once(kind):
    layout = json.loads((DOCS / f"foxglove-{kind}.json").read_text())

    def placed(tree) -> list[str]:
        return [tree] if isinstance(tree, str) else placed(tree["first"]) + placed(tree["second"])

    assert sorted(placed(layout["layout"])) == sorted(layout["configById"])


@pytest.mark.parametrize("kind", ["run", "drive"])
def test_the_scene_follows_a_frame_of_the_record(kind, messages):
    layout = json.loads((DOCS / f"foxglove-{kind}.json").read_text())
    follows = layout["configById"]["3D!scene"]["followTf"]
    tf = messages[kind]["/tf"][1].transforms[0]
    odometry = messages[kind]["/odom"][1]
    assert follows in {tf.header.frame_id, tf.child_frame_id, odometry.child_frame_id}
