"""The commands of the README, of tutorials and how-tos, run as they stand in the pages.

Lines of blocks tagged `sh` run one by one, `console` ones are held against what they print,
`python` ones are executed. What cannot run here says why: `<!-- not run: WHY -->` above the block.
Of `make` only its target has to be there. The notebooks of examples/ run, cell by cell.
"""

import ast
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from elfslam.base.errors import ElfslamError
from elfslam.cli.app import run
from studies.tree import ROOT

README = ROOT / "README.md"
TUTORIAL = sorted((ROOT / "docs" / "tutorial").glob("*.md"))
HOW_TO = sorted((ROOT / "docs" / "how-to").glob("*.md"))
REASONS = {
    "needs a cluster", "needs a floor plan", "needs an export of a phone", "needs a broker",
    "needs a server with a map", "needs recordings of other people", "runs until it is stopped",
    "takes minutes", "takes hours",
}  # fmt: skip
BLOCK = re.compile(
    r"(?:<!-- not run: (?P<why>[^>]+?) -->\n)?^```(?P<tag>[\w-]*)\n(?P<text>.*?)^```$", re.S | re.M
)
IN_STOCK = re.compile(r"^elfslam (?:simulate|map) .*\n", re.M)
"""In the README: the tutorial has these commands as they stand, and the stock what they make."""
STOCK = (
    "elfslam simulate studio walk --seed 100 --rounds 3",
    "elfslam simulate studio walk2 --seed 101 --rounds 3",
    "elfslam simulate studio query --seed 1100 --rounds 1 --asking",
    "elfslam map walk run",
    "elfslam map walk2 run2",
    "mkdir walks && cp -r walk2 walks/walk2 && cp -r query walks/query",
)
"""What how-tos take as given: walks of a small room, and their maps."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
SLACK, SLACK_LEAST = 0.2, 3.0
"""Printed numbers may be this share off what a page shows, or this many units of their last digit:
libraries of other machines round otherwise."""
LONGEST_S = 900


@dataclass(frozen=True)
class Block:
    """A block of code of a page."""

    tag: str
    text: str
    why: str | None


def blocks(page: Path) -> Iterator[Block]:
    for found in BLOCK.finditer(page.read_text(encoding="utf-8")):
        yield Block(found["tag"], found["text"], found["why"])


def page_name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def shell(text: str, folder: Path) -> str:
    """What commands print in a folder, errors too. Fails where one fails."""
    environment = os.environ | {
        "HOME": str(folder),
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": f"{ROOT / 'src'}:{ROOT}",
        "COLUMNS": "160",
    }
    asked = f'make() {{ grep -q "^$1:" "{ROOT / "Makefile"}"; }}\n'
    ended = subprocess.run(
        ["bash", "-e", "-o", "pipefail", "-c", asked + text],
        cwd=folder, env=environment, timeout=LONGEST_S, check=False, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    assert ended.returncode == 0, f"{text}\n{ended.stdout}"
    return ended.stdout


def run_block(block: Block, folder: Path) -> None:
    if block.tag == "python":
        run_python(block.text, folder)
    elif block.tag == "toml" and block.text.startswith("# "):
        (folder / block.text.splitlines()[0].removeprefix("# ")).write_text(block.text)
    elif block.tag == "console":
        run_session(block.text, folder)
    elif block.tag == "sh":
        for line in block.text.splitlines():
            printed_by(line, folder)


def printed_by(line: str, folder: Path) -> str:
    """What a line of a shell prints, errors too; our own command has its libraries loaded here."""
    words, output = shlex.split(line, comments=True), io.StringIO()
    if words[:1] != ["elfslam"]:
        return shell(line, folder)
    with (
        chdir(folder),
        redirect_stdout(output),
        redirect_stderr(output),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("HOME", str(folder))
        code = run(words[1:])
    assert code == 0, f"{line}\n{output.getvalue()}"
    return output.getvalue()


def run_session(text: str, folder: Path) -> None:
    """Commands behind `$`, and below each what it prints, other lines of it left out."""
    for session in re.split(r"^\$ ", text, flags=re.M)[1:]:
        command, *shown = session.splitlines()
        printed = printed_by(command, folder).splitlines()
        for line in filter(str.strip, shown):
            assert any(alike(line, other) for other in printed), f"{line}\n{printed}"


def alike(shown: str, printed: str) -> bool:
    """Whether two lines have the same words, and numbers that hardly differ."""
    words = [NUMBER.sub("#", line).split() for line in (shown, printed)]
    if words[0] != words[1]:
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(printed), strict=True)
    return all(
        abs(float(a) - float(b)) <= max(SLACK * abs(float(a)), SLACK_LEAST * unit_of(a))
        for a, b in pairs
    )


def unit_of(number: str) -> float:
    """Of its last digit: 0.01 of "0.31"."""
    return float(10.0 ** -len(number.partition(".")[2]))


NAMES: dict[str, object] = {}
"""What the blocks of a page have defined so far."""


def run_python(text: str, folder: Path) -> None:
    """Statements one by one; one that is refused has the refusal below it, as a comment."""
    with chdir(folder):
        for statement in ast.parse(text).body:
            refusal = refusal_of(statement)
            assert not refusal or refusal in text, refusal


def refusal_of(statement: ast.stmt) -> str:
    """Execute a statement; what a page shows of a refusal, empty where there is none."""
    try:
        exec(compile(ast.Module([statement], []), "page", "exec"), NAMES)
    except ElfslamError as refused:
        return f"# {type(refused).__name__}: {refused}\n"
    return ""


def to_run(page: Path) -> list[Block]:
    return [block for block in blocks(page) if block.why is None]


def run_page(page: Path, folder: Path) -> None:
    """Asserts that what it runs succeeds and prints what the page shows."""
    NAMES.clear()
    assert to_run(page)
    for block in to_run(page):
        text = IN_STOCK.sub("", block.text) if page == README else block.text
        run_block(Block(block.tag, text, None), folder)


@pytest.fixture(scope="session")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with small walks and their maps."""
    folder = tmp_path_factory.mktemp("stock")
    for command in STOCK:
        printed_by(command, folder)
    return folder


@pytest.mark.real
@pytest.mark.parametrize("page", TUTORIAL, ids=page_name)
def test_tutorials_run_from_nothing(page: Path, tmp_path: Path) -> None:
    run_page(page, tmp_path)


@pytest.mark.real
@pytest.mark.parametrize(
    "page", [page for page in (README, *HOW_TO) if to_run(page)], ids=page_name
)
def test_how_tos_run_with_walks_and_maps(page: Path, stock: Path, tmp_path: Path) -> None:
    folder = tmp_path / "here"
    shutil.copytree(stock, folder)
    run_page(page, folder)


@pytest.mark.parametrize("page", [README, *TUTORIAL, *HOW_TO], ids=page_name)
def test_blocks_are_tagged_and_say_why_they_are_not_run(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert [block.text for block in blocks(page) if not block.tag] == []
    assert {block.why for block in blocks(page)} - {None} <= REASONS
    assert text.count("<!-- not run:") == sum(block.why is not None for block in blocks(page))
    assert re.findall(r"^    +(?:\$|elfslam|make) .*", text, re.M) == []


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("63   46   2", " 63 47 2 ", True),
        ("63   46   2", "63 30 2", False),
        ("0.31 m", "0.33 m", True),
        ("0.31 m", "0.41 m", False),
        ("2 walks", "2 maps", False),
    ],
)
def test_printed_lines_are_held_against_the_page(shown: str, printed: str, same: bool) -> None:
    assert alike(shown, printed) is same


def test_a_block_is_found_with_its_reason(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("text\n<!-- not run: takes hours -->\n```sh\na\n```\n\n```console\n$ b\n```\n")
    assert [*blocks(page)] == [Block("sh", "a\n", "takes hours"), Block("console", "$ b\n", None)]


def test_a_refusal_in_a_page_is_the_one_that_comes(tmp_path: Path) -> None:
    NAMES.clear()
    start = "import elfslam\nelfslam.map(1)\n# InputError: no such refusal\n"
    with pytest.raises(AssertionError):
        run_python(start, tmp_path)


EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def run_cells(name: str) -> dict[str, Any]:
    """What the code cells of a notebook define."""
    cells = json.loads((EXAMPLES / name).read_text(encoding="utf-8"))["cells"]
    defined: dict[str, Any] = {}
    for number, cell in enumerate(cells):
        if cell["cell_type"] == "code":
            assert cell["outputs"] == [], "notebooks are kept without what they printed"
            exec(compile("".join(cell["source"]), f"{name}, cell {number}", "exec"), defined)
    return defined


@pytest.mark.real
def test_a_walk_is_mapped_and_another_located_in_it() -> None:
    defined = run_cells("map_and_locate.ipynb")
    assert defined["run"].trajectory.status == "OK"
    assert len(defined["floor_map"].sources) == 2
    assert (defined["fixes"].status == 0).mean() > 0.9


@pytest.mark.real
def test_an_encoder_and_a_similarity_of_ones_own_map_as_well() -> None:
    defined = run_cells("your_own_stage.ipynb")
    mine, joint = defined["mine"], defined["joint"]
    assert mine.similarity.kind == "elf:root-spectrum-1"
    assert joint.similarity.kind == "elf beside root spectrum"
    for each in (mine, joint):
        errors = defined["medians_m"](each)
        assert errors["SLAM"] < errors["dead reckoning"]
