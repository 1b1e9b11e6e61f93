"""The card of an encoder: what it is and how it was made, in the metadata of its own file."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from elfslam.base.errors import InputError
from elfslam.base.parameters import digest
from elfslam.base.text_files import parse_json


@dataclass(frozen=True)
class Pretraining:
    """All that is needed to train the encoder again: the same, on the same machine.

    `echoes` is how many were learnt from, `arithmetic` what numbers that was done in, and `loss`
    the mean over the last tenth of the steps.
    """

    software: str
    seed: int
    echoes: int
    arithmetic: str
    loss: float
    parameters: Mapping[str, Any]
    parameters_digest: str


@dataclass(frozen=True)
class Finetuning:
    """How the encoder `parent` (its identity) learnt one walk, and what came of it."""

    parent: str
    software: str
    seed: int
    echoes: int
    outcome: str
    parameters: Mapping[str, Any]
    parameters_digest: str


@dataclass(frozen=True)
class Card:
    """What an encoder is, in a few lines of "word: sentence", and how it was made.

    `metrics` are figures by name. An encoder that was only fine-tuned here has no `pretraining`.
    """

    text: str
    pretraining: Pretraining | None = None
    finetunings: tuple[Finetuning, ...] = ()
    metrics: Mapping[str, float] = field(default_factory=dict)


TEXTS = {"card", "software", "arithmetic", "parameters_digest"}
"""Entries of the metadata that are words; the others are JSON."""
ENTRIES = {"card", "finetunings", "metrics", *Pretraining.__dataclass_fields__}


def metadata_of(card: Card) -> dict[str, str]:
    """The card as the entries of a file's metadata: words as they are, all else as JSON."""
    made = {} if card.pretraining is None else asdict(card.pretraining)
    entries = {
        "card": card.text,
        **made,
        "finetunings": [asdict(item) for item in card.finetunings],
        "metrics": dict(card.metrics),
    }
    return {
        name: value if name in TEXTS else json.dumps(value, sort_keys=True)
        for name, value in entries.items()
    }


def card_in(metadata: Mapping[str, str]) -> Card | None:
    """The card in a file's metadata, None where there is none. Raises InputError for a damaged one.

    Entries that a later version may have added are passed over.
    """
    if "card" not in metadata:
        return None
    try:
        known = {name: _value(name, text) for name, text in metadata.items() if name in ENTRIES}
        trained = {name: known[name] for name in Pretraining.__dataclass_fields__ if name in known}
        return Card(
            text=known["card"],
            pretraining=Pretraining(**trained) if trained else None,
            finetunings=tuple(Finetuning(**item) for item in known["finetunings"]),
            metrics=dict(known["metrics"]),
        )
    except (InputError, KeyError, TypeError, ValueError) as cause:
        raise InputError(
            "card: wanted the metadata that `elfslam pretrain` writes, got another "
            f"({cause!r:.120}); "
            "export the encoder again"
        ) from cause


def _value(name: str, text: str) -> Any:
    return text if name in TEXTS else parse_json(text, name)


def training_facts(parameters: Any) -> dict[str, Any]:
    """The parameters of a training, plain, and the digest that `run.json` gives of them too."""
    return {"parameters": asdict(parameters), "parameters_digest": digest(parameters)}


def card_rows(card: Card) -> Iterator[dict[str, object]]:
    """The card as rows of `what` and `value`, in the order that a person reads."""
    for line in card.text.splitlines():
        word, colon, sentence = line.partition(": ")
        yield _row(word, sentence) if colon else _row("", line)
    if card.pretraining is not None:
        yield from (_row(name, value) for name, value in asdict(card.pretraining).items())
    for count, item in enumerate(card.finetunings, start=1):
        for name, value in asdict(item).items():
            yield _row(f"fine-tuning {count}: {name}", value)
    yield from (_row(name, value) for name, value in card.metrics.items())


def _row(what: str, value: object) -> dict[str, object]:
    return {"what": what, "value": value}
