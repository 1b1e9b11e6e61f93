"""What an error says fits a screen, whatever it quotes."""

import pickle

import pytest

from elfslam.base.errors import LONGEST_CHARACTERS, ElfslamError, InputError


def test_a_sentence_comes_as_it_was_written() -> None:
    said = "map.npz: holds no poses, wanted some; map a walk first"
    assert str(InputError(said)) == said
    assert str(pickle.loads(pickle.dumps(InputError(said)))) == said


@pytest.mark.parametrize("quoted", ["9" * 5000, "x" * LONGEST_CHARACTERS])
def test_a_long_quotation_is_cut_in_its_middle(quoted: str) -> None:
    said = str(ElfslamError(f"world.toml: knows no {quoted}; remove it"))
    assert said.startswith("world.toml: knows no ")
    assert said.endswith("; remove it")
    assert len(said) < LONGEST_CHARACTERS
