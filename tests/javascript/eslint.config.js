// Lints the pages: unused and undefined names, and what the recommended rules know.
import js from "@eslint/js";
import globals from "globals";

const pages = "src/elfslam/serve/pages";

export default [
  { ignores: [`${pages}/vendor/**`] },
  js.configs.recommended,
  {
    files: [`${pages}/**/*.js`],
    linterOptions: { reportUnusedDisableDirectives: "error" },
    languageOptions: { globals: { ...globals.browser } },
    rules: {
      eqeqeq: "error",
      "no-var": "error",
      "prefer-const": ["error", { destructuring: "all" }],
      "no-unused-vars": ["error", { argsIgnorePattern: "^_" }],
    },
  },
  {
    files: [`${pages}/**/*.worker.js`, `${pages}/service_worker.js`],
    languageOptions: { globals: { ...globals.worker, ...globals.serviceworker, VERSION: "readonly" } },
  },
  {
    files: [`${pages}/**/*.worklet.js`],
    languageOptions: { globals: { ...globals.audioWorklet } },
  },
];
