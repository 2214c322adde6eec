"""The paper's laws and ours: pure functions of numbers, compiled."""
