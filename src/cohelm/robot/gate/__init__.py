"""The gate: the last check before the wheels. It refuses or limits commands, and says why.

It shares no code with the law and works when the law is wrong. `modes` defines the gate's modes;
`bounds` limits speeds and accelerations; `gate` applies both, with the watchdog.
"""
