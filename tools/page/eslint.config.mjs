// The page's scripts are joined in one scope, in the order of SCRIPTS in
// hlsd/report/page.py: what one file declares at its top is known in all others.

import { readFileSync, readdirSync } from "node:fs";
import { fileURLToPath } from "node:url";

import js from "@eslint/js";
import globals from "globals";

const folder = fileURLToPath(new URL("../../hlsd/report/page/", import.meta.url));
const files = readdirSync(folder).filter((name) => name.endsWith(".js"));
const text = Object.fromEntries(
  files.map((name) => [name, readFileSync(folder + name, "utf-8")]),
);
const declared = Object.fromEntries(
  files.map((name) => [
    name,
    [...text[name].matchAll(TOP_LEVEL())].map(([, found]) => found),
  ]),
);

export default [
  js.configs.recommended,
  ...files.map((name) => ({
    files: [`hlsd/report/page/${name}`],
    languageOptions: {
      ecmaVersion: 2023,
      sourceType: "script",
      globals: { ...globals.browser, ...declaredBeside(name) },
    },
    linterOptions: { reportUnusedDisableDirectives: "error" },
    rules: {
      eqeqeq: "error",
      "no-implicit-globals": "off", // the shared scope is meant
      "no-shadow": ["error", { allow: [], builtinGlobals: false }],
      "no-unused-vars": [
        "error",
        { vars: "all", args: "after-used", varsIgnorePattern: usedBeside(name) },
      ],
      "no-var": "error",
      "prefer-const": "error",
    },
  })),
];

/** Names that a script declares at its top level. */
function TOP_LEVEL() {
  return /^(?:async function|function|const|let|class) (\w+)/gm;
}

/** What the other scripts declare, read-only here. */
function declaredBeside(name) {
  const others = files.filter((other) => other !== name);
  return Object.fromEntries(
    others.flatMap((other) => declared[other].map((found) => [found, "readonly"])),
  );
}

/** Names of this script that another one uses, as a pattern. */
function usedBeside(name) {
  const used = declared[name].filter((found) =>
    files.some(
      (other) => other !== name && new RegExp(`\\b${found}\\b`).test(text[other]),
    ),
  );
  return `^(${used.join("|")})$`;
}
