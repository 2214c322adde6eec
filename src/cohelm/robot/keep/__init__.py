"""A robot behind its gate, in this process or in one that outlives the loop."""
