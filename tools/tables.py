"""Write the tables in docs/ that say what the code says: `python tools/tables.py`.

A table stands between `<!-- table: NAME -->` and `<!-- end -->`; the test of the documentation
fails where one is not what this would write, so a renamed field needs this script and no editing.
"""

from __future__ import annotations

import inspect
import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

DOCS = Path(__file__).resolve().parents[1] / "docs"
RESULTS = DOCS.parent / "benchmarks" / "counts"
BOUNDS = {"exclusiveMinimum": ">", "minimum": "≥", "maximum": "≤", "exclusiveMaximum": "<"}
WORDS = {"boolean": "`true` or `false`", "string": "text", "array": "list", "object": "keys"}
TYPES = {"float64": "float64", "int64": "int64", "bool": "bool"}
_BLOCK = re.compile(r"(<!-- table: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
Json = dict[str, Any]


def forms(schema: Json, whole: Json) -> list[Json]:
    """The forms a value may have, none left out but null, references followed."""
    found = [form for form in schema.get("anyOf", [schema]) if form.get("type") != "null"]
    return [whole["$defs"][f["$ref"].split("/")[-1]] if "$ref" in f else f for f in found]


def allowed(schema: Json, whole: Json) -> str:
    """What a value may be."""
    form = forms(schema, whole)[0]
    if "const" in form:
        return f"`{form['const']}`"
    if "enum" in form:
        return " or ".join(f"`{value}`" for value in form["enum"])
    if form.get("type") in ("number", "integer"):
        bounds = (f"{sign} {form[key]:g}" for key, sign in BOUNDS.items() if key in form)
        return ("whole number, " if form["type"] == "integer" else "") + ", ".join(bounds)
    return WORDS.get(form.get("type", ""), "")


def keys(
    model: Json, above: str, whole: Json, unit: bool = False, listed: dict[str, str] | None = None
) -> Iterator[str]:
    """One table row for every key of a model and of the models below it.

    listed: models whose keys stand in the table already, and under which key; they are named once.
    """
    listed = {} if listed is None else listed
    for name, schema in model["properties"].items():
        key, default = f"{above}{name}", schema.get("default")
        plain = default is not None and not isinstance(default, dict | list) and default != ""
        said = f"`{str(default).lower() if isinstance(default, bool) else default}`"
        needed = name in model.get("required", [])
        shown = "**needed**" if needed else said if plain else "–"
        meaning = " ".join(schema.get("description", "").split())
        cells = [f"`{key}`", allowed(schema, whole), shown, meaning]
        if unit:
            cells[1:2] = [_unit(name) or "–", cells[1] or "any number"]
        yield f"| {' | '.join(cells)} |"
        form = forms(schema, whole)[0]
        items = forms(form["items"], whole)[0] if "items" in form else {}
        below = form if "properties" in form else items
        if "properties" in below:
            prefix = f"{key}.N." if below is items else f"{key}."
            if below["title"] in listed:
                empty = " |" * (len(cells) - 2)
                yield f"| `{prefix}…` |{empty} As of `{listed[below['title']]}`. |"
                continue
            listed[below["title"]] = key
            yield from keys(below, prefix, whole, unit, listed)


def robot() -> list[str]:
    """Every key of a robot's YAML file."""
    from cohelm.robot.model import RobotModel

    schema = RobotModel.model_json_schema()
    head = ["| key | unit | allowed | default | meaning |", "|---|---|---|---|---|"]
    return [*head, *keys(schema, "", schema, unit=True)]


def units() -> list[str]:
    """Suffixes of keys, and what they mean."""
    from cohelm.scenario.explain import UNITS

    rows = (f"| `_{suffix}` | {unit} |" for suffix, unit in UNITS.items())
    return ["| a key that ends in | is in |", "|---|---|", *rows]


def period() -> list[str]:
    """Every field of a control period."""
    from cohelm.core.row import MEANINGS, ROW
    from cohelm.record.period import ARRAYS

    rows = [f"| `{name}` | float64[] | {_cell(said)} |" for name, said in ARRAYS.items()]
    return [*_fields(ROW, MEANINGS, str.lower), *rows]


def messages() -> list[str]:
    """Every message of the link, with its largest size; and the version of all."""
    from cohelm.link import messages, wire

    head = ["| kind | message | way | largest [byte] | what |", "|---|---|---|---|---|"]
    return [f"Version {messages.VERSION}:", "", *head] + [
        f"| {kind} | {of.__name__} | {'up' if kind in wire.UP else 'down'}, "
        f"{'datagram' if of in wire.DATAGRAMS else 'bulk'} | {wire.largest(of)} | {_what(of)} |"
        for kind, (of, _) in wire.LAYOUTS.items()
    ]


def _what(message: type) -> str:
    """What a message's docstring says it is."""
    paragraph = inspect.cleandoc(message.__doc__ or "").partition("\n\n")[0]
    return _cell(" ".join(paragraph.split(": ", 1)[1].removesuffix(".").split()))


def _fields(
    kind: np.dtype[Any], meanings: dict[str, str], named: Callable[[str], str]
) -> list[str]:
    rows = [
        f"| `{named(name)}` | {TYPES[kind[name].name]} | {_cell(meanings[name])} |"
        for name in kind.names or ()
    ]
    return ["| field | type | meaning |", "|---|---|---|", *rows]


def closed_loop() -> list[str]:
    """Drives of `python -m benchmarks.closed_loop`, those of a map and variant in one row."""
    said = {
        "drawn": "as drawn", "gone": "30 % of the walls gone", "missing": "30 % missing on the map",
        "boxes": "ten new boxes",
    }  # fmt: skip
    drives: dict[tuple[str, str], list[Json]] = {}
    for row in _results("closed_loop.jsonl"):
        place, seed = row["name"].rsplit(", ", 1)
        drives.setdefault((place, row["variant"]), []).append({**row, "seed": seed})
    head = [
        "| map, seeds | arrived | rms | 99 % | largest | lost | wrong and sure | longest |",
        "|---|---|---|---|---|---|---|---|",
        "| *asked, as drawn* | all | ≤ 5 cm | ≤ 15 | | ≤ 1 % | ≤ 0.1 % | ≤ 1 s |",
        "| *asked, boxes or walls gone* | all | | | | | ≤ 0.5 % | |",
    ]
    return head + [
        f"| `{place}`, {said[variant]}, {', '.join(r['seed'] for r in rows)} "
        f"| {sum(r['arrived'] for r in rows)} of {len(rows)} | {_rms(rows)} cm "
        f"| {_worst(rows, 'at_99')} | {_worst(rows, 'largest')} | {_share(rows, 'lost')} "
        f"| {_share(rows, 'wrong')} | {max(r['longest'] for r in rows):.1f} s |"
        for (place, variant), rows in sorted(drives.items())
    ]


def beside() -> list[str]:
    """The same drives by several ways to localise: `python -m benchmarks.places beside`."""
    drives: dict[tuple[str, str], dict[str, list[Json]]] = {}
    for row in _results("beside.jsonl"):
        methods = drives.setdefault((row["name"], row["variant"]), {})
        methods.setdefault(row["method"], []).append(row)
    names = list(next(iter(drives.values())))
    return [
        f"| map, seeds | {' | '.join(names)} |", "|---" * (1 + len(names)) + "|",
        *(
            f"| `{place}`, {variant}, {', '.join(str(r['seed']) for r in methods[names[0]])} | "
            + " | ".join(
                f"{_rms(rows)}, {_worst(rows, 'largest')} cm; {_share(rows, 'wrong')}; "
                f"{_share(rows, 'lost')}"
                for rows in (methods[name] for name in names)
            )
            + " |"
            for (place, variant), methods in sorted(drives.items())
        ),
    ]  # fmt: skip


def drives() -> list[str]:
    """Drives by perception alone: `python -m benchmarks.places drives`."""
    found: dict[tuple[str, str], list[Json]] = {}
    for row in _results("drives.jsonl"):
        found.setdefault((f"`{row['name']}`", row["variant"]), []).append(row)
    head = [
        "| map, drives | variant | rms | 99 % | largest | lost | wrong and sure | longest | e/σ "
        "| a scan | over 10 ms |",
        "|---" * 11 + "|",
    ]
    return head + [
        f"| {place}, {len(rows)} | {variant} | {_rms(rows)} cm | {_worst(rows, 'at_99')} "
        f"| {_worst(rows, 'largest')} | {_share(rows, 'lost')} | {_share(rows, 'wrong')} "
        f"| {max(r['longest'] for r in rows):.1f} s | {max(r['sigmas'] for r in rows):.1f} "
        f"| {_middle(rows, 'ms'):.1f} ms | {_share(rows, 'slow')} |"
        for (place, variant), rows in sorted(found.items())
    ]


def kidnaps() -> list[str]:
    """Pushes and told places: `python -m benchmarks.places kidnaps`."""
    found: dict[tuple[str, str, str], list[Json]] = {}
    for row in _results("kidnaps.jsonl"):
        found.setdefault((row["kind"], row["senses"], _family(row["name"])), []).append(row)
    head = [
        "| what | map | found | within 3 s | median, 90 % | wrong and sure > 1 s | a scan "
        "| over 10 ms |",
        "|---" * 8 + "|",
    ]
    return head + [
        f"| {', '.join(filter(None, (kind, senses)))} | {place} | {_of(rows, _found)} "
        f"| {_of(rows, lambda r: r['last'] < 3.0)} "
        f"| {_middle(rows, 'last'):.1f}, {_quantile(rows, 'last', 0.9):.1f} s "
        f"| {_of(rows, lambda r: r['longest'] > 1.0)} | {_middle(rows, 'ms'):.1f} ms "
        f"| {_share(rows, 'slow')} |"
        for (kind, senses, place), rows in _with_all(found)
    ]


def cold() -> list[str]:
    """Switched on with no idea where: `python -m benchmarks.places cold`."""
    found: dict[tuple[str, str, str], list[Json]] = {}
    for row in _results("cold.jsonl"):
        found.setdefault((row["kind"], row["senses"], _family(row["name"])), []).append(row)
    head = ["| senses | map | right within 10 s | median | ever wrong and sure |", "|---" * 5 + "|"]
    return head + [
        f"| {senses or 'as usual'} | {place} | {_of(rows, lambda r: r['right'] <= 10.0)} "
        f"| {_middle(rows, 'right'):.1f} s | {_of(rows, lambda r: r['wrong'] > 0.0)} |"
        for (_, senses, place), rows in _with_all(found)
    ]


def _with_all(found: dict[tuple[str, str, str], list[Json]]) -> list[Any]:
    """Those of each map, and before them those of all."""
    whole: dict[tuple[str, str, str], list[Json]] = {}
    for (kind, senses, _), rows in found.items():
        whole.setdefault((kind, senses, "**all**"), []).extend(rows)
    return sorted({**whole, **found}.items())


def _family(place: str) -> str:
    return "buildings" if place.startswith("building") else "published maps"


def _found(row: Json) -> bool:
    return row["last"] < 8.5


def _of(rows: list[Json], which: Callable[[Json], bool]) -> str:
    return f"{sum(which(row) for row in rows)} of {len(rows)}"


def _middle(rows: list[Json], key: str) -> float:
    return _quantile(rows, key, 0.5)


def _quantile(rows: list[Json], key: str, share: float) -> float:
    """Of the rows, one of them: what never came is infinite."""
    return sorted(row[key] for row in rows)[min(int(share * len(rows)), len(rows) - 1)]


def _results(name: str) -> list[Json]:
    """What a benchmark has measured: a line a drive."""
    return [json.loads(line) for line in (RESULTS / name).read_text("utf-8").splitlines()]


def _rms(rows: list[Json]) -> str:
    """Of some drives, while they were not lost [cm]."""
    sure = [row["rms"] for row in rows if math.isfinite(row["rms"])]
    return f"{100 * math.sqrt(sum(r**2 for r in sure) / len(sure)):.1f}" if sure else "–"


def _worst(rows: list[Json], key: str) -> str:
    sure = [row[key] for row in rows if math.isfinite(row[key])]
    return f"{100 * max(sure):.1f}" if sure else "–"


def _share(rows: list[Json], key: str) -> str:
    share = 100 * sum(row[key] for row in rows) / len(rows)
    return f"{share:.2f} %" if share else "0"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _unit(name: str) -> str:
    from cohelm.scenario.explain import unit_of

    return unit_of((name,))


TABLES: dict[str, Callable[[], list[str]]] = {
    "robot": robot, "units": units, "period": period, "messages": messages,
    "closed-loop": closed_loop, "beside": beside,
    "drives": drives, "kidnaps": kidnaps, "cold": cold,
}  # fmt: skip


def written(page: str) -> str:
    """A page with its tables as they should be."""

    def table(found: re.Match[str]) -> str:
        return f"{found[1]}\n" + "\n".join(TABLES[found[2]]()) + f"\n\n{found[3]}"

    return _BLOCK.sub(table, page)


def main() -> None:
    """Write them all."""
    for path in sorted(DOCS.glob("*.md")):
        old = path.read_text(encoding="utf-8")
        new = written(old)
        if new != old:
            path.write_text(new, encoding="utf-8")
            print(path.name)


if __name__ == "__main__":
    main()
