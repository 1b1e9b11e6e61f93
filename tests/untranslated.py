"""What of a page is still in English: its texts, compared with those of a catalogue."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

WORDS = Path(__file__).parents[1] / "src" / "elfslam" / "serve" / "pages" / "words"
SEEN = """() => {
  const found = [document.title];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const { parentElement: inside } = node;
    const isSeen = inside.checkVisibility() && !inside.closest("noscript, option[lang]");
    if (isSeen) found.push(node.textContent);
  }
  for (const name of ["aria-label", "title", "placeholder"]) {
    for (const each of document.querySelectorAll(`[${name}]`)) {
      if (each.checkVisibility()) found.push(each.getAttribute(name));
    }
  }
  return found.map((text) => text.replace(/\\s+/g, " ").trim()).filter(Boolean);
}"""
CLIPPED = """() => {
  const kinds = "button, .button, .badge, h1, h2, label, dt, legend, nav, .scroll";
  return [...document.querySelectorAll(kinds)].filter((each) => {
    const { display, textOverflow } = getComputedStyle(each);
    const isMeant = textOverflow === "ellipsis" || each.closest(".visually-hidden");
    if (isMeant || display === "inline" || !each.checkVisibility()) return false;
    return each.scrollWidth > each.clientWidth + 1;
  }).map((each) => `${each.tagName} ${each.textContent.trim().slice(0, 40)}`);
}"""
FEWEST_WORDS = 2
"""A text with values in it is known by so many words of its own."""


@cache
def english(language: str) -> tuple[re.Pattern[str], ...]:
    """The texts that another language says otherwise, as patterns."""
    words = json.loads((WORDS / f"{language}.json").read_text(encoding="utf-8"))
    others = [key for key, text in words.items() if key != text]
    texts = [re.sub(r"_(one|other|verb|column)$", "", key) for key in others]
    return tuple(_pattern(text) for text in texts if _is_telling(text))


def _is_telling(text: str) -> bool:
    rest = re.sub(r"{{.*?}}", " ", text)
    return rest == text or len(re.findall(r"[^\W\d_]{2,}", rest)) >= FEWEST_WORDS


def _pattern(text: str) -> re.Pattern[str]:
    parts = re.split(r"{{.*?}}", text)
    return re.compile(".+".join(map(re.escape, parts)))


def left_in_english(page: Any, language: str) -> list[str]:
    """The texts of a page that its language says otherwise: what is seen, and names of controls."""
    seen = {str(text) for text in page.evaluate(SEEN)}
    return sorted(text for text in seen if any(each.fullmatch(text) for each in english(language)))


def clipped(page: Any) -> list[str]:
    """Buttons, headings and the like whose words do not fit into them."""
    return [str(each) for each in page.evaluate(CLIPPED)]
