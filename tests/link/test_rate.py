"""Token buckets, and log lines under a flood."""

from hypothesis import given, strategies as st

from cohelm.link.rate import Coalesced, TokenBucket


@given(st.lists(st.floats(0.0, 0.2), min_size=1, max_size=300))
def test_the_token_bucket_limits_rate_and_burst(waits):
    bucket, now, passed = TokenBucket(20.0, 5.0, 100.0), 100.0, []
    for wait in waits:
        now += wait
        if bucket.take(now):
            passed.append(now)
    for i, first in enumerate(passed):
        for k, last in enumerate(passed[i:]):
            assert k + 1 <= 5.0 + 20.0 * (last - first) + 1e-6


def test_a_sender_below_the_rate_always_passes():
    bucket = TokenBucket(20.0, 5.0, 0.0)
    assert all(bucket.take(0.05 * k + 1e-9) for k in range(1000))


def test_the_first_log_line_is_written_at_once_and_a_flood_once_a_second():
    lines, said = Coalesced(), []
    for k in range(10_000):  # ten seconds at a thousand a second
        said += lines.add(0.001 * k, "anna", "anna asks for STOP")
    said += lines.due(20.0)
    assert said[0] == "anna asks for STOP"
    assert len(said) <= 12
    counted = sum(int(line.split("(")[1].split()[0]) for line in said[1:])
    assert counted == 9_999


def test_one_sender_does_not_suppress_the_log_lines_of_another():
    lines = Coalesced()
    assert lines.add(0.0, "anna", "a") == ["a"]
    assert lines.add(0.1, "berta", "b") == ["b"]
    assert lines.add(0.2, "anna", "a") == []
    assert lines.add(5.0, "berta", "b") == ["a", "b"]


def test_memory_is_bounded_for_any_number_of_names():
    lines, said = Coalesced(), []
    for k in range(10_000):
        said += lines.add(0.001 * k, k, f"client {k}")
    assert len(said) < 1000
    assert len(lines._kept) <= 65
