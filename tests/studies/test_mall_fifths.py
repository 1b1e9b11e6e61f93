"""The study of held-out walks on the first few of a real floor, and without any."""

from __future__ import annotations

import json

import pytest

from elfslam.base.errors import InputError
from studies.mall_fifths import METHODS, measure_mall_fifths


def quiet(what, share):
    pass


def test_real_walks_are_wanted():
    with pytest.raises(InputError, match="wanted real walks"):
        measure_mall_fifths(None, quiet)


def test_a_few_real_walks_in_small_and_goes_on_where_it_was(shared_data, tmp_path):
    kept = tmp_path / "kept"
    small = {"floors": ("F1",), "most_walks": 8}
    finding = measure_mall_fifths(shared_data, quiet, kept, **small)
    assert [row["method"] for row in finding.rows] == list(METHODS)
    assert all(row["used to"] == "develop" and row["walks"] == 8 for row in finding.rows)
    found = json.loads(kept.read_text())
    assert len(found) == 5
    first = next(iter(found))
    kept.write_text(json.dumps({first: found[first]}))
    assert measure_mall_fifths(shared_data, quiet, kept, **small).rows == finding.rows
