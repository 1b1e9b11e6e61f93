"""What people read on the phone page and the desk page is in the catalogue of every language."""

import hashlib
import json
import re
import shutil
import subprocess
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest

from elfslam.serve.jobs.work import STAGES
from tests.serve.pages.refusals import refusals

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
PAGES = ROOT / "src" / "elfslam" / "serve" / "pages"
TOOLS = ROOT / "tests" / "javascript" / "package.json"
CATALOGUES = sorted((PAGES / "words").glob("*.json"))
HTML = ("phone.html", "desk.html", "trust.html", "missing.html")
FOLDERS = ("phone", "keeping", "shared", "stages", "desk")
READ = ("aria-label", "title", "placeholder", "alt")
NOT_WORDS = ("script", "style", "noscript")
NEVER_CLOSED = ("input", "link", "meta")
I18NEXT = "e3090e0bb373e28255610bc3cd4f8df52f2282b36488c44f90dec2705c58b600"
"""SHA-256 of dist/esm/i18next.js of i18next 26.7.2, as npm has it."""
NO_WORDS = {
    "application/json, application/octet-stream", "elfslam …, phone page", "Android", "Problem",
    "Bearer …", "no element …", "script, style, noscript, [translate=no]", "Enter", "no room",
    "Fourier transform: wanted a power of two, got …", "elfslam serve", "page waiting",
    "map-page waiting", "yaw rate", "magnetic field", "air pressure", "access points",
    "sound level",
    "Indoor Location Competition", "Sensor Logger", "… Hz", "Files",
    "linear-gradient(to right, …)", "600 13px system-ui, sans-serif",
    "650 15px system-ui, sans-serif", "… …px system-ui, sans-serif", "primary big",
    "comparing walks", "joining walks", "step length",
}  # fmt: skip
"""What looks like words and is not for people."""
SAID_BY_STAGES = "stages/"
"""What these scripts refuse is with figures, as in Python, and in English everywhere."""


class Texts(HTMLParser):
    """The texts of a page that are language: those of elements, and those of attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()
        self._inside: list[bool] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Into an element, whose attributes may hold words."""
        given = dict(attrs)
        is_none = tag in NOT_WORDS or given.get("translate") == "no"
        if not (is_none or any(self._inside)):
            self._add(*(given.get(name) or "" for name in READ))
        if tag not in NEVER_CLOSED:
            self._inside.append(is_none)

    def handle_endtag(self, tag: str) -> None:
        """Out of it."""
        self._inside.pop()

    def handle_data(self, data: str) -> None:
        """What stands between."""
        if not any(self._inside):
            self._add(data)

    def _add(self, *texts: str) -> None:
        bare = (" ".join(text.split()) for text in texts)
        self.found |= {text for text in bare if re.search(r"[^\W\d_]{2}", text)}


def texts_of(html: str) -> set[str]:
    texts = Texts()
    texts.feed(html)
    texts.close()
    return texts.found


@cache
def scripts() -> dict[str, dict[str, list]]:
    """By script: keys, counted texts, what looks like words and is none of them, computed keys."""
    node = shutil.which("node")
    if node is None or not (TOOLS.parent / "node_modules" / "espree").is_dir():
        pytest.skip("node or espree is missing: make lint-pages brings espree")
    files = [file for folder in FOLDERS for file in sorted((PAGES / folder).rglob("*.js"))]
    files.append(PAGES / "trust.js")
    command = [node, HERE / "words_of_scripts.mjs", TOOLS, *files]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told = json.loads(done.stdout)
    return {Path(name).relative_to(PAGES).as_posix(): found for name, found in told.items()}


@cache
def forms(language: str) -> list[str]:
    """How a language counts: one and other, or more than these."""
    asked = f"JSON.stringify(new Intl.PluralRules('{language}').resolvedOptions().pluralCategories)"
    done = subprocess.run(
        [str(shutil.which("node")), "-p", asked], capture_output=True, text=True, check=True
    )
    return list(json.loads(done.stdout))


def keys(language: str) -> set[str]:
    """What a catalogue must hold, all of it and nothing else."""
    found = set().union(*(texts_of((PAGES / name).read_text()) for name in HTML))
    for script in scripts().values():
        found |= set(script["keys"])
        found |= {f"{many}_{form}" for _, many in script["counted"] for form in forms(language)}
    return found | refusals()


def catalogue(file: Path) -> dict[str, str]:
    """A catalogue; a key that stands twice is a mistake."""

    def once(pairs: list[tuple[str, str]]) -> dict[str, str]:
        assert len(dict(pairs)) == len(pairs), "a key stands twice"
        return dict(pairs)

    return json.loads(file.read_text(encoding="utf-8"), object_pairs_hook=once)


def placeholders(text: str) -> list[str]:
    return sorted(re.findall(r"{{(.*?)}}", text))


@pytest.mark.parametrize("file", CATALOGUES, ids=lambda file: file.stem)
def test_a_catalogue_has_every_text_and_no_other(file: Path) -> None:
    wanted, got = keys(file.stem), set(catalogue(file))
    assert sorted(wanted - got) == [], "not translated"
    assert sorted(got - wanted) == [], "nobody says this any more"


@pytest.mark.parametrize("file", CATALOGUES, ids=lambda file: file.stem)
def test_a_translation_says_what_the_text_says(file: Path) -> None:
    words = catalogue(file)
    assert {key for key, text in words.items() if not text.strip()} == set()
    wrong = {key for key, text in words.items() if placeholders(key) != placeholders(text)}
    assert wrong == set(), "other values than in the English text"
    ends = {key for key, text in words.items() if key[-1] in ".?…" and key[-1] != text[-1]}
    assert ends == set(), "another kind of sentence than in English"


def test_every_other_language_is_one_file() -> None:
    found = re.search(r"LANGUAGES = (\[.*\]);", (PAGES / "shared" / "language.js").read_text())
    assert found
    assert sorted(json.loads(found[1])) == sorted(["en", *(file.stem for file in CATALOGUES)])


def test_no_key_is_computed() -> None:
    computed = {name for name, script in scripts().items() if script["computed"]}
    assert computed <= {"shared/words.js"}, "t, counted, woven and marked take texts as they are"


def test_no_words_for_people_stand_outside_the_catalogues() -> None:
    bare = [
        (name, text)
        for name, script in scripts().items()
        for text in script["bare"]
        if text not in NO_WORDS and not name.startswith(SAID_BY_STAGES)
    ]
    assert bare == []


def test_the_looking_finds_what_was_forgotten(tmp_path: Path) -> None:
    scripts()
    planted = tmp_path / "planted.js"
    planted.write_text(
        'import { a } from "The module";\n'
        'h("p", { class: "big soft" }, "Not translated", `It is ${a} late`);\n'
        't("Said" + " so", { a }); t(a); t("Map", { context: "verb" });\n'
        'counted(2, "{{count}} job", "{{count}} jobs"); h("b", null, "Delete");\n'
        'console.warn("For us");\n'
        'marked("a thing"); woven("Open {{a}}.", { a: h("i", null, "Inside it") });\n'
    )
    command = [str(shutil.which("node")), HERE / "words_of_scripts.mjs", TOOLS, planted]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = json.loads(told)[str(planted)]
    assert found["keys"] == ["Said so", "Map_verb", "a thing", "Open {{a}}."]
    assert found["counted"] == [["{{count}} job", "{{count}} jobs"]]
    assert found["bare"] == ["Not translated", "It is … late", "Delete", "Inside it"]
    assert len(found["computed"]) == 1


def test_refusals_are_read_from_the_source_of_the_server() -> None:
    found = refusals()
    assert "there is no such {{1}} here; it may have been deleted" in found
    assert "this map is somebody else's, and only they may do that; ask them" in found
    assert "this pairing token is not known here; ask for a new one" in found
    assert not [text for text in found if "Upload-Length" in text]


def test_html_is_read_as_the_page_reads_it() -> None:
    html = """<title>A title</title><script>No words</script><p>Two
      lines <b>inside</b> 5 B</p><p translate="no">A name</p><noscript>No script</noscript>
      <input placeholder="Say it" title="x"><a aria-label="Go there" href="#Not">…</a>"""
    assert texts_of(html) == {"A title", "Two lines", "inside", "Say it", "Go there"}


def test_every_stage_of_a_job_has_words() -> None:
    told = (PAGES / "shared" / "format.js").read_text()
    assert [name for name in STAGES if f't("{name}")' not in told] == []


def test_the_library_is_what_npm_has() -> None:
    vendored = PAGES / "vendor" / "i18next"
    assert hashlib.sha256((vendored / "i18next.js").read_bytes()).hexdigest() == I18NEXT
    assert "The MIT License" in (vendored / "LICENSE").read_text()
