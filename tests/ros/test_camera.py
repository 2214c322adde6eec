"""A ROS 2 robot's camera, for who looks through it."""

import io
import time

import numpy as np
import pytest
from PIL import Image
from rosbags.typesys.stores.ros2_jazzy import (
    sensor_msgs__msg__CompressedImage as CompressedImage,
    sensor_msgs__msg__Image as RawImage,
)

from cohelm.core.errors import CohelmError
from cohelm.core.types import Pose
from cohelm.drive.pictures import Pictures
from cohelm.record.ros2 import header
from cohelm.robot.port import Encoded, Frame
from cohelm.ros.camera import COMPRESSED, Camera, CameraTopic, choose, pixels
from cohelm.ros.clock import Clock
from cohelm.ros.mismatch import IMAGE
from cohelm.ros.port import SENSOR, Endpoint, Qos, Received
from cohelm.ros.robot import topics_of

EYE = "/camera/image_raw/compressed"


def published(topic, kind=COMPRESSED):
    return Endpoint(topic, kind, Qos(False, False, 5), True, "/driver")


def test_a_single_compressed_topic_is_used_and_of_several_none_by_default():
    one, depth = published(EYE), published("/camera/depth/image_raw/compressedDepth")
    assert choose(None, [one, depth, published("/scan", IMAGE)]) == (
        CameraTopic(EYE, COMPRESSED), f"pictures: {EYE}"
    )  # fmt: skip
    chosen, said = choose(None, [one, published("/rear/image/compressed")])
    assert chosen is None
    assert said == (
        "pictures: none of /camera/image_raw/compressed, /rear/image/compressed; choose one with "
        "--topic camera=TOPIC"
    )
    assert choose("", [one]) == (None, "")
    assert choose(None, []) == (None, "")
    assert choose("/raw", [one, published("/raw", IMAGE)])[0] == CameraTopic("/raw", IMAGE)


def test_one_that_is_named_and_not_there_is_a_sentence():
    with pytest.raises(
        CohelmError, match=r"no node publishes /eye: .*--topic camera=TOPIC.*" + EYE
    ):
        choose("/eye", [published(EYE)])
    with pytest.raises(CohelmError, match="/scan is sensor_msgs/msg/LaserScan"):
        choose("/scan", [published("/scan", "sensor_msgs/msg/LaserScan")])


def test_no_name_means_no_pictures_and_a_namespace_counts():
    assert topics_of(["camera="]).camera == ""
    assert topics_of([]).camera is None
    assert topics_of(["camera=eye", "namespace=/j100"]).camera == "/j100/eye"


class Air:
    """A transport on which a test speaks."""

    def subscribe(self, topic, kind, qos, heard):
        assert (topic, kind, qos) == (EYE, COMPRESSED, SENSOR) or kind == IMAGE
        self.heard = heard
        return lambda: None

    def says(self, message):
        self.heard(Received(message, time.monotonic(), ""))


def jpeg(size=(64, 48), kind="JPEG"):
    file = io.BytesIO()
    Image.new("RGB", size, (200, 10, 10)).save(file, kind)
    return file.getvalue()


def compressed(data, age=0.1):
    stamp = header(time.time_ns() - round(age * 1e9), "camera")
    return CompressedImage(stamp, "jpeg", np.frombuffer(data, dtype=np.uint8))


def test_a_picture_is_sent_once_with_its_age_and_jpeg_unchanged():
    air = Air()
    camera = Camera(air, CameraTopic(EYE, COMPRESSED), Clock())
    assert camera(50.0) is None
    air.says(compressed(jpeg()))
    air.says(None)  # damaged
    got = camera(50.0)
    assert isinstance(got, Encoded)
    assert got.stamp == pytest.approx(49.9, abs=0.05)
    assert camera(50.1) is None
    pictures = Pictures(waits=True)
    pictures.give(got, Pose(0.0, 0.0, 0.0))
    assert pictures.take().data == jpeg()
    air.says(compressed(jpeg(kind="PNG"), age=-5.0))  # from tomorrow: as it came
    other = camera(60.0)
    assert (other.stamp, other.number) == (60.0, 1)
    pictures.give(other, Pose(0.0, 0.0, 0.0))
    assert pictures.take().data[:2] == b"\xff\xd8"


def raw(encoding, data, width, height, step):
    return RawImage(header(time.time_ns(), "camera"), height, width, encoding, 0, step, data)


@pytest.mark.parametrize(
    ("encoding", "pixel"),
    [
        ("rgb8", [200, 100, 50]), ("bgr8", [50, 100, 200]), ("rgba8", [200, 100, 50, 255]),
        ("bgra8", [50, 100, 200, 255]), ("8UC3", [50, 100, 200]),
    ],
)  # fmt: skip
def test_raw_pictures_are_accepted_in_any_color_order(encoding, pixel):
    row = np.array(pixel * 3 + [7] * 5, dtype=np.uint8)  # rows may be longer than their pixels
    made = pixels(raw(encoding, np.tile(row, 2), 3, 2, len(row)))
    assert made.shape == (2, 3, 3)
    assert (made == [200, 100, 50]).all()
    pictures = Pictures(waits=True)
    pictures.give(Frame(0.0, 0, made), Pose(0.0, 0.0, 0.0))
    assert Image.open(io.BytesIO(pictures.take().data)).size == (3, 2)


def test_grey_is_grey():
    made = pixels(raw("mono8", np.arange(6, dtype=np.uint8), 3, 2, 3))
    assert (made[..., 0] == made[..., 2]).all()
    assert made[1, 2, 1] == 5


@pytest.mark.parametrize(
    ("image", "why"),
    [
        (raw("16UC1", np.zeros(12, np.uint8), 3, 2, 6), "encoded as '16UC1'"),
        (raw("rgb8", np.zeros(12, np.uint8), 3, 2, 9), "does not fit its 12 bytes"),
        (raw("rgb8", np.zeros(12, np.uint8), 3, 2, 6), "does not fit"),
        (raw("rgb8", np.zeros(12, np.uint8), 0, 2, 6), "does not fit"),
    ],
)
def test_an_invalid_picture_is_reported_once_and_is_harmless(image, why, caplog):
    with pytest.raises(CohelmError, match=why):
        pixels(image)
    air = Air()
    camera = Camera(air, CameraTopic("/raw", IMAGE), Clock())
    for _ in range(3):
        air.says(image)
        assert camera(1.0) is None
    assert len(caplog.records) == 1


def test_a_file_that_is_no_picture_is_harmless():
    pictures = Pictures(waits=False)
    pictures.give(Encoded(0.0, 0, b"\xff\xd8 nonsense"), Pose(0.0, 0.0, 0.0))
    pictures.give(Encoded(0.1, 1, jpeg()), Pose(0.0, 0.0, 0.0))
    end = time.monotonic() + 10.0
    while (got := pictures.take()) is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    assert got.number == 1
    pictures.close()
