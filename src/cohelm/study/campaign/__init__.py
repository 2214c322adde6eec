"""Many episodes, judged: suites of cases, driven under one law or several, counted exactly.

`case` one episode; `rooms`, `movers`, `lab`, `hands`, `barn`, `crowd`, `adversary` the suites,
which `suites` lists; `episode` drives a case and makes its row; `store` keeps the rows; `runner`
and `cluster` drive many; `stats` and `report` say what came out.
"""
