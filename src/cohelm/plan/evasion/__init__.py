"""Evades moving obstacles: goes round, lets pass, backs off or steps aside.

`params` what can be set and what is being done, `movers` who matters and how he goes on, `standing`
the distance to what stands, `case` all that candidates are held against, `risk` how near movers
will be, `candidates` the motions to choose from, `foretold` a motion foretold and its cost, `evade`
the choice.
"""
