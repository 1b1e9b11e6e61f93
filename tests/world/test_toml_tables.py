"""Tables of a TOML file: values come out, lines are found however the file is written."""

import pytest

from elfslam.base.errors import InputError
from elfslam.world import toml_tables
from elfslam.world.toml_tables import Table, read_table

TEXT = """\
# a comment = 1
name = "x"
corners = [
  [1.0, 2.0],
  [3.0, 4.0],
]
climate.warm = 3

[one] # header
value = 7
"quoted" = 2

[[many]]
name = "first"
value = 1

[[many]]

value = 2
"""


@pytest.fixture
def top() -> Table:
    return read_table(TEXT, "x.toml")


def line_of(given: Table, key: str = "") -> int:
    return int(str(given.refusal("wrong", key)).split()[2].strip(":,"))


def test_every_key_has_its_line(top: Table) -> None:
    assert [line_of(top, key) for key in ("", "name", "corners", "climate", "one")] == [
        1, 2, 3, 7, 9,
    ]  # fmt: skip
    one = toml_tables.table(top, "one")
    assert [line_of(one, key) for key in ("", "value", "quoted", "missing")] == [9, 10, 11, 9]
    first, second = toml_tables.tables(top, "many")
    assert [line_of(first), line_of(first, "name"), line_of(first, "value")] == [13, 14, 15]
    assert [line_of(second), line_of(second, "value")] == [17, 19]
    assert (first.label, second.label) == ('many 1 "first"', "many 2")


def test_tables_without_headers_get_the_line_of_their_key() -> None:
    top = read_table('x = 1\nmany = [{ name = "a" }, { name = "b" }]\none = { y = 2 }\n', "f")
    assert [line_of(item) for item in toml_tables.tables(top, "many")] == [2, 2]
    assert line_of(toml_tables.table(top, "one"), "y") == 3


@pytest.mark.parametrize("value", ["inf", "nan", "true", '"7"', "[7]", "-501", "501"])
def test_what_is_no_number_of_metres_is_refused(value: str) -> None:
    with pytest.raises(InputError, match=r"^f line 2: x is .*, wanted a number from -500 to 500"):
        toml_tables.number(read_table(f"\nx = {value}", "f"), "x")


def test_a_missing_value_and_an_unknown_key_are_refused(top: Table) -> None:
    with pytest.raises(InputError, match=r"^x\.toml line 17, many 2: lacks name; add it"):
        toml_tables.text(toml_tables.tables(top, "many")[1], "name")
    with pytest.raises(InputError, match=r"line 11, one: knows no 'quoted'; .* mean 'quote'"):
        toml_tables.check_keys(toml_tables.table(top, "one"), ("value", "quote"))
    with pytest.raises(InputError, match="line 11, one: knows no 'quoted'; wanted value; remove"):
        toml_tables.check_keys(toml_tables.table(top, "one"), ("value",))


@pytest.mark.parametrize(
    ("text", "line"), [("x = 1\ny = = 2\n", 2), ("x = 1\n\nx = 2\n", 3), ("x = [1,", 1)]
)
def test_what_is_no_toml_is_refused_with_its_line(text: str, line: int) -> None:
    with pytest.raises(InputError, match=f"^f line {line}: is no TOML") as refusal:
        read_table(text, "f")
    assert "\n" not in str(refusal.value)
