"""Cards: into a file's metadata and back, and what is refused."""

import json
from dataclasses import asdict, dataclass

import pytest

from elfslam.base import card as cards
from elfslam.base.card import Card, Finetuning, card_in, card_rows, metadata_of, training_facts
from elfslam.base.errors import InputError
from elfslam.base.parameters import digest, parameter


@dataclass(frozen=True)
class Learning:
    """Parameters of a training that does not exist."""

    steps: int = parameter(7, "", "batches")
    rate: float = parameter(0.25, "", "learning rate")


PRETRAINING = cards.Pretraining("elfslam 1", 3, 3584, "float32", 1.25, **training_facts(Learning()))
FINETUNING = Finetuning("0123", "elfslam 2", 4, 600, "better", **training_facts(Learning(steps=2)))
CARD = Card("Encoder: hears\nLimits: many", PRETRAINING, (FINETUNING,), {"recall": 0.5})


@pytest.mark.parametrize(
    "card", [CARD, Card("words"), Card("", PRETRAINING), Card("x", None, (FINETUNING, FINETUNING))]
)
def test_a_card_survives_its_file(card: Card) -> None:
    metadata = metadata_of(card)
    assert all(isinstance(text, str) for text in metadata.values())
    assert card_in(metadata) == card


def test_every_fact_of_the_training_is_an_entry_of_its_own() -> None:
    metadata = metadata_of(CARD)
    assert metadata["card"] == CARD.text
    assert metadata["software"] == "elfslam 1"
    assert json.loads(metadata["parameters"]) == {"steps": 7, "rate": 0.25}
    assert metadata["parameters_digest"] == digest(Learning())
    numbers = {name: json.loads(metadata[name]) for name in ("seed", "echoes", "loss", "metrics")}
    assert numbers == {"seed": 3, "echoes": 3584, "loss": 1.25, "metrics": {"recall": 0.5}}


def test_the_order_of_the_metrics_does_not_change_the_entries() -> None:
    one, other = (Card("x", metrics=dict(pairs)) for pairs in ([("a", 1), ("b", 2)],) * 2)
    turned = Card("x", metrics={"b": 2, "a": 1})
    assert metadata_of(one) == metadata_of(other) == metadata_of(turned)


@pytest.mark.parametrize("metadata", [{}, {"author": "someone", "seed": "not ours"}])
def test_another_maker_s_file_has_no_card(metadata: dict[str, str]) -> None:
    assert card_in(metadata) is None


def test_what_a_later_version_adds_is_passed_over() -> None:
    assert card_in({**metadata_of(CARD), "colour": "{"}) == CARD


@pytest.mark.parametrize(
    "damage",
    [
        {"seed": "three"},
        {"parameters": "{"},
        {"metrics": "7"},
        {"finetunings": '[{"seed": 1}]'},
        {"finetunings": "null"},
        {"seed": None},
        {"metrics": None},
    ],
)
def test_a_damaged_card_is_refused(damage: dict[str, str | None]) -> None:
    entries = {**metadata_of(CARD), **damage}
    metadata = {name: text for name, text in entries.items() if text is not None}
    with pytest.raises(InputError, match=r"card: wanted the metadata that .* export the encoder"):
        card_in(metadata)


def test_a_person_reads_the_words_first_then_how_it_was_made() -> None:
    rows = list(card_rows(CARD))
    assert rows[:2] == [{"what": "Encoder", "value": "hears"}, {"what": "Limits", "value": "many"}]
    shown = {row["what"]: row["value"] for row in rows}
    assert {name: shown[name] for name in asdict(PRETRAINING)} == asdict(PRETRAINING)
    assert shown["fine-tuning 1: parent"] == "0123"
    assert rows[-1] == {"what": "recall", "value": 0.5}
    assert list(card_rows(Card("no colon"))) == [{"what": "", "value": "no colon"}]
