"""The pilot: reference governor, tracking, blending, filter, and replanning.

`step` is the fast part, once per control step. `replanning` is the slow one, a few times a second:
detours, path re-entry, recovery; `rollout` predicts the drive for it. `delay_compensation` predicts
to the moment at which a command takes effect, `margin_inflation` adds the errors of perception to
the margins. For a caller in Python, `pilot` has both parts, `safety_filter` the filter alone.
"""
