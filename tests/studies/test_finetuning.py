"""The study of fine-tuning, in miniature."""

from __future__ import annotations

from elfslam.learn.parameters import FinetuneParameters
from studies.finetuning import measure_finetuning

TINY = FinetuneParameters(
    steps=2, pairs=16, warmup_steps=1, learning_rate=1e-5, check_steps=2, shortest_s=20.0, threads=1
)


def test_a_row_before_and_one_after() -> None:
    shares: list[float | None] = []
    before, after = measure_finetuning(
        None,
        lambda what, share: shares.append(share),
        worlds=("studio",),
        seeds=(108,),
        rounds=2,
        parameters=TINY,
    )
    assert (before["encoder"], after["encoder"]) == ("pre-trained", "fine-tuned")
    assert before["same place (pairs)"] == after["same place (pairs)"]
    assert 0.5 < float(str(before["recall at 1 %"])) <= 1.0
    assert abs(float(str(after["AUC"])) - float(str(before["AUC"]))) < 0.05
    assert shares == [0.0]
