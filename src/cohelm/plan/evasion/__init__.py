"""Evades moving obstacles: goes round, lets pass, backs off or steps aside.

`params` has the parameters and the state, `movers` the relevant movers and their accelerations,
`static_obstacles` a grid of distances to static obstacles, `context` all that candidates are
evaluated against, `risk` the risk near predicted movers, `candidates` the motions to choose from,
`predicted_motion` the rollout of a motion and its cost, `evade` the choice.
"""
