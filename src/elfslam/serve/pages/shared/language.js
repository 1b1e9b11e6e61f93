/*
 * Which language the page speaks: the one that was chosen here, or the first of the browser's that we have. Not a
 * module: it runs before anything is shown, so that nothing is shown in the wrong language meanwhile.
 */
(() => {
  /** English is the source; each other one is a file `words/LANGUAGE.json`. */
  const LANGUAGES = ["en", "de"];
  const CHOSEN = "elfslam-language";
  /** Whatever goes wrong, the page is shown after so long. */
  const PATIENCE_MS = 8000;
  const root = document.documentElement;
  /** The page of unknown addresses may be anywhere: what is fetched lies beside this script. */
  const here = /** @type {HTMLScriptElement} */ (document.currentScript).src;

  /** What was chosen here before; a browser that keeps nothing has chosen nothing. */
  function chosenBefore() {
    try {
      return localStorage.getItem(CHOSEN) ?? "";
    } catch {
      return "";
    }
  }

  /** @param {string} tag such as "de-CH" */
  const languageOf = (tag) => tag.toLowerCase().split("-")[0];
  const preferred = [chosenBefore(), ...navigator.languages].map(languageOf);
  const language = preferred.find((each) => LANGUAGES.includes(each)) ?? LANGUAGES[0];
  const isSource = language === LANGUAGES[0];

  /** @param {string} next */
  function choose(next) {
    try {
      localStorage.setItem(CHOSEN, next);
    } catch {
      return; // where nothing is kept, the browser's own order of languages is all there is
    }
    location.reload();
  }

  /** Null where it cannot be had: the page then speaks English. @returns {Promise<Record<string, string> | null>} */
  async function fetched() {
    try {
      const answer = await fetch(new URL(`../words/${language}.json`, here));
      return answer.ok ? await answer.json() : null;
    } catch {
      return null;
    }
  }

  root.lang = language;
  if (!isSource) {
    root.dataset.words = "coming";
    setTimeout(() => delete root.dataset.words, PATIENCE_MS);
  }
  window.elfslamLanguage = {
    language, languages: LANGUAGES, choose,
    locale: navigator.languages.find((tag) => languageOf(tag) === language) ?? language,
    catalogue: isSource ? Promise.resolve({}) : fetched(),
  };
})();
