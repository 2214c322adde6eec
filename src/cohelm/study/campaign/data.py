"""Where in the folder of --data the files of a suite are."""

from __future__ import annotations

from pathlib import Path


def data_folder(given: Path, name: str) -> Path:
    """The folder of this name in the given one, or that one itself."""
    return given / name if (given / name).is_dir() else given


def csv_files(given: Path, name: str) -> tuple[Path, list[Path]]:
    """That folder, and its CSV files, plain or gzip."""
    folder = data_folder(given, name)
    return folder, sorted([*folder.glob("*.csv"), *folder.glob("*.csv.gz")])
