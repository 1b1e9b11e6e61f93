// What can be used or means something, and has no name that a screen reader could say.
() => {
  const wanted =
    "button, a[href], input, select, textarea, canvas, progress, table, dialog, [role=img]";
  const text = (element) => (element?.textContent ?? "").trim();
  const named = (element) =>
    element.getAttribute("aria-label") ||
    text(document.getElementById(element.getAttribute("aria-labelledby"))) ||
    [...(element.labels ?? [])].map(text).join("") ||
    (!element.matches("table, dialog, progress") && text(element)) ||
    element.title;
  return [...document.querySelectorAll(wanted)]
    .filter((element) => element.checkVisibility() && !named(element))
    .map((element) => element.outerHTML.slice(0, 120));
}
