"""Campaigns: suites of many episodes, driven under one law or several, scored and counted.

`episode` is one of them; `rooms`, `movers`, `lab`, `hands`, `barn`, `crowd`, `adversary`, `heights`
are the suites, which `suites` lists; `scoring` drives one and makes its result; `store` keeps the
rows; `runner` and `cluster` drive many; `stats` and `report` summarize.
"""
