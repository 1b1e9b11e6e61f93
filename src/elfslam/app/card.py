"""The card of an encoder: what was measured of it, written into its file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from elfslam.base.errors import InputError
from elfslam.base.text_files import read_json
from elfslam.data.folders import new_file
from elfslam.line.closure import ClosureParameters
from elfslam.line.feature import OnnxEncoder, load_encoder

CLOSING = f"at {ClosureParameters().threshold:g}"
ON_THE_CARD = ("AUC", "recall at 1 %", "recall at 0.1 %", f"kept {CLOSING}", f"false {CLOSING}")


def write_measured(encoder: str, measured: Path, out: Path, *, overwrite: bool = False) -> None:
    """Write the encoder to `out` with the figures of a study's table on its card."""
    from elfslam.learn.onnx_files import with_metrics

    with new_file(out, overwrite=overwrite, reads=[encoder, measured]) as partial:
        metrics = metrics_of(read_json(measured))
        known = load_encoder(encoder)
        content = known.content if isinstance(known, OnnxEncoder) else b""
        partial.write_bytes(with_metrics(content, metrics))


def metrics_of(table: object) -> dict[str, float]:
    """What a card says of one encoder, from the rows of `study elf` about it.

    Raises InputError where the rows are of none or of several, or of another study.
    """
    rows: list[Any] = table if isinstance(table, list) else [table]
    features = {str(row["feature"]) if _is_row(row) else "another table" for row in rows}
    if len(features) != 1 or not all(map(_is_row, rows)):
        raise InputError(
            f"figures: wanted the rows of `python -m studies elf` about one encoder, got "
            f"{', '.join(sorted(features)) or 'none':.200}; name the encoder with --encoder there"
        )
    return {
        f"{name}, {row['compared']}, {row['world']}": float(row[name])
        for row in rows
        for name in ON_THE_CARD
    }


def _is_row(row: object) -> bool:
    """Whether this is a row of the study's table, as JSON gives it."""
    return isinstance(row, dict) and all(
        isinstance(row.get(name), kind)
        for names, kind in ((("feature", "compared", "world"), str), (ON_THE_CARD, int | float))
        for name in names
    )
