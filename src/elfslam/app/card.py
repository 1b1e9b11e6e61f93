"""The card of an encoder: what was measured of it, written into its file."""

from pathlib import Path

from elfslam.base.errors import InputError
from elfslam.data.atomic_files import new_file
from elfslam.data.tables import number_in, read_named_rows
from elfslam.stages.closure import ClosureParameters
from elfslam.stages.feature import OnnxEncoder, load_encoder

CLOSING = f"at {ClosureParameters().threshold:g}"
ON_THE_CARD = (
    "AUC", "recall at 1 % false positives", "recall at 0.1 % false positives",
    f"recall {CLOSING}", f"false positives {CLOSING}",
)  # fmt: skip
COLUMNS = ("study", "world", "method", "condition", "metric", "value")


def write_measured(encoder: str, measured: Path, out: Path, *, overwrite: bool = False) -> None:
    """Write the encoder to `out` with the figures of a study's results on its card."""
    from elfslam.learn.onnx_files import with_metrics

    with new_file(out, overwrite=overwrite, reads=[encoder, measured]) as partial:
        metrics = metrics_of(measured)
        known = load_encoder(encoder)
        content = known.content if isinstance(known, OnnxEncoder) else b""
        partial.write_bytes(with_metrics(content, metrics))


def metrics_of(measured: Path) -> dict[str, float]:
    """What a card says of one encoder, from the results of the study `elf` about it.

    Raises InputError where they are of no encoder or of several, or of another study.
    """
    rows = read_named_rows(measured, COLUMNS)
    methods = {row["method"] if row["study"] == "elf" else "another study" for row in rows}
    if len(methods) != 1 or "another study" in methods:
        raise InputError(
            f"{measured}: wanted results of `python -m studies elf` about one encoder, got "
            f"{', '.join(sorted(methods)) or 'none':.200}; name one encoder there"
        )
    try:
        return {
            f"{row['metric']}, {row['condition']}, {row['world']}": number_in(row["value"])
            for row in rows
            if row["metric"] in ON_THE_CARD
        }
    except ValueError as cause:
        raise InputError(f"{measured}: {cause} is no number; run the study again") from cause
