"""Options from a ROS 2 parameter file."""

import pytest

pytest.importorskip("cyclonedds", reason="cyclonedds has no wheel for this machine")


def filtered(cohelm, tmp_path, text, *arguments):
    (tmp_path / "robot.yaml").write_text(text)
    return cohelm("filter", "--params", "robot.yaml", *arguments)


def parameters(text, node="cohelm_filter"):
    return f"{node}:\n  ros__parameters: {{{text}}}\n"


def test_the_command_line_takes_precedence_over_a_parameter_file(cohelm, tmp_path):
    text = parameters("robot: sally, transport: foxglove, url: 'ws://127.0.0.1:9', wait: 2.0")
    said = filtered(cohelm, tmp_path, text)
    assert "no foxglove_bridge answers at ws://127.0.0.1:9" in said.err
    said = filtered(cohelm, tmp_path, text, "--url", "ws://127.0.0.1:7")
    assert "no foxglove_bridge answers at ws://127.0.0.1:7" in said.err


@pytest.mark.parametrize("topics", ["'rear=/scan'", "[rear=/scan]"])
def test_the_topics_of_further_lidars_may_be_one_or_a_list(cohelm, tmp_path, topics):
    said = filtered(cohelm, tmp_path, parameters(f"robot: sally-rear, further_scan: {topics}"))
    assert "two LiDARs of sally-rear can not share a topic, and both are on /scan" in said.err


@pytest.mark.parametrize("simulated", ["true", "false"])
@pytest.mark.parametrize("node", ["/**", "/j100/cohelm_filter"])
def test_wildcards_and_namespaces_follow_ros(cohelm, tmp_path, node, simulated):
    text = parameters(f"robot: sally, use_sim_time: {simulated}, transport: pigeon", node)
    assert "--transport 'pigeon'" in filtered(cohelm, tmp_path, text).err


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (parameters("robbot: sally"), "robbot: there is no such parameter; did you mean robot?"),
        (parameters("use_sim_time: 1"), "use_sim_time: there is no such parameter"),
        (parameters("robot: sally, timeout: abc"), "invalid value for '--timeout'"),
        (parameters("robot: sally, timeout: 99.0"), "invalid value for '--timeout'"),
        (parameters("url: [a, b]"), "url: must be one value, got ['a', 'b']"),
        (parameters("allow_bypass: 3"), "allow_bypass: must be true or false, got 3"),
        (parameters("timeout: true"), "timeout: must be no truth value, got True"),
        (parameters("robot: sally", "nav2"), "has no parameters of this node"),
        ("[1, 2", "not valid YAML"),
        ("7", "has no parameters of this node"),
        ("cohelm_filter: {ros__parameters: 7}", "has no parameters of this node"),
    ],
)
def test_errors_in_a_mask_are_reported_in_one_sentence(cohelm, tmp_path, text, words):
    said = filtered(cohelm, tmp_path, text)
    assert said.code == 2
    assert words in said.err
    assert "Traceback" not in said.err


def test_a_missing_file_is_reported(cohelm):
    said = cohelm("filter", "--params", "none.yaml")
    assert (said.code, "none.yaml: no such file" in said.err) == (2, True)
