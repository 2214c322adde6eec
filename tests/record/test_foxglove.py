"""The Foxglove layout in docs/ names only topics and fields of a record."""

import json
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from cohelm.record.topics import TOPICS
from tests.ports.adapters import recorded as drive
from tests.record.runs import lab, recorded as run

LAYOUT = json.loads((Path(__file__).parents[2] / "docs" / "foxglove.json").read_text())
TYPES = {
    "3D": {"MarkerArray", "Path", "OccupancyGrid", "LaserScan"},
    "Image": {"CompressedImage"},
    "Plot": {"Period"},
    "StateTransitions": {"Period"},
    "DiagnosticSummary": {"DiagnosticArray"},
    "RosOut": {"Log"},
}


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """Of each kind of record: topic -> one of its messages."""
    folder = tmp_path_factory.mktemp("records")
    run(folder / "run.mcap", lab(duration=0.5))
    drive(folder / "drive.mcap", 1.0)
    found = {}
    for kind in ("run", "drive"):
        with (folder / f"{kind}.mcap").open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            found[kind] = {
                channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()
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
def test_the_layout_names_only_what_a_record_holds(kind, messages):
    for panel, settings in LAYOUT["configById"].items():
        assert named(panel, settings)
        for path in named(panel, settings):
            topic, _, field = path.partition(".")
            form = TOPICS[topic].split("/")[-1]
            assert form in TYPES[panel.partition("!")[0]], path
            if kind == "drive":
                assert topic in messages[kind], path  # a run has no camera, scans and events
            if field:
                assert isinstance(getattr(messages[kind][topic], field), float | int | bool), path


def test_every_panel_is_in_the_layout_once():
    def placed(tree) -> list[str]:
        return [tree] if isinstance(tree, str) else placed(tree["first"]) + placed(tree["second"])

    assert sorted(placed(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


@pytest.mark.parametrize("kind", ["run", "drive"])
def test_the_scene_follows_a_frame_of_the_record(kind, messages):
    follows = LAYOUT["configById"]["3D!scene"]["followTf"]
    assert follows == messages[kind]["/odom"].child_frame_id
