"""Names that users choose by: known ones are taken, others refused with what there is."""

import pytest

from elfslam.base.enums import Modality, parse_modalities
from elfslam.base.errors import ParameterError


def test_senses_come_in_the_order_they_are_named() -> None:
    assert parse_modalities("wifi, elf") == (Modality.WIFI, Modality.ELF)
    assert parse_modalities(None) == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("smell", "wanted elf, wifi, magnetic, emr, motion, got 'smell'"),
        ("elf,elf", "name each modality once"),
        ("elf,motion", "motion closes no loops"),
        ("", "got ''"),
    ],
)
def test_senses_that_are_none_are_refused(text: str, words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        parse_modalities(text)
