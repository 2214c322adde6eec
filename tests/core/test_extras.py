"""A feature whose packages are not installed says, in one sentence, what to install."""

import importlib.util
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from cohelm.core.extras import missing, requirements

SOURCES = Path(__file__).parents[2] / "src"


@pytest.mark.parametrize("extra", ["campaign", "cluster", "map", "peers", "stick"])
def test_each_extra_is_named_by_packages_that_pip_can_install_before_any_release(extra):
    found = requirements(extra)
    assert found
    assert not [one for one in found if Requirement(one).name == "cohelm"]


def test_the_sentence_names_what_for_and_the_cure():
    assert str(missing("mapping", "map")) == (
        "mapping needs what is not installed here: pip install 'gtsam>=4.3'"
    )


def test_no_message_names_a_package_registry_without_cohelm():
    told = [f.name for f in SOURCES.rglob("*.py") if "pip install cohelm" in f.read_text()]
    told += [f.name for f in SOURCES.rglob("*.py") if "cohelm[" in f.read_text()]
    assert [name for name in told if name != "extras.py"] == []


def test_the_station_and_the_twin_need_no_extra():
    needed = {"OpenSSL", "cryptography", "mujoco", "starlette", "uvicorn", "websockets"}
    assert [name for name in needed if importlib.util.find_spec(name) is None] == []
    text = (SOURCES.parent / "pyproject.toml").read_text()
    required = text.split("dependencies = [")[1].split("\n]")[0]
    for name in ("cryptography", "mujoco", "pyopenssl", "starlette", "uvicorn", "websockets"):
        assert f'"{name}>=' in required
