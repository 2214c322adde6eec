"""Many episodes, judged: suites of episodes, driven under one law or several, counted exactly.

`episode` one of them; `rooms`, `movers`, `lab`, `hands`, `barn`, `crowd`, `adversary` the suites,
which `suites` lists; `scoring` drives one and makes its result; `store` keeps the rows; `runner`
and `cluster` drive many; `stats` and `report` say what came out.
"""
