"""Who keeps the wheels: a robot and its gate, here or in a process that outlives the loop."""
