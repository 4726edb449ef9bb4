/* A row per world and planner, that sorts and filters. */

const mean = (values) => {
  const known = values.filter((value) => value !== null);
  return known.length
    ? known.reduce((sum, value) => sum + value, 0) / known.length
    : null;
};
const least = (values) => {
  const known = values.filter((value) => value !== null);
  return known.length ? Math.min(...known) : null;
};

/* Heads of columns: title, value of a row, text of a value. */
const COLUMNS = [
  ["world", (row) => row.index, String],
  ["planner", (row) => row.planner, null],
  [
    "success",
    (row) => row.successes / row.runs.length,
    (_, row) => `${row.successes} / ${row.runs.length}`,
  ],
  [
    "mean time [s]",
    (row) => mean(row.runs.map((run) => run.time_s)),
    (value) => number(value, 2),
  ],
  [
    "contacts",
    (row) => mean(row.runs.map((run) => run.contacts)),
    (value) => number(value, 1),
  ],
  [
    "least clearance [m]",
    (row) => least(row.runs.map((run) => run.min_clearance_m)),
    (value) => number(value, 3),
  ],
  [
    "path [m]",
    (row) => mean(row.runs.map((run) => run.path_length_m)),
    (value) => number(value, 2),
  ],
  [
    "recoveries",
    (row) => mean(row.runs.map((run) => run.recoveries)),
    (value) => number(value, 1),
  ],
];

/* The metrics that these columns are of. */
const COLUMN_METRICS = {
  success: "success",
  "mean time [s]": "time_s",
  contacts: "contacts",
  "least clearance [m]": "min_clearance_m",
  "path [m]": "path_length_m",
  recoveries: "recoveries",
};

const table = { rows: [], column: 0, descending: false, show: null };
const ROWS_PER_PAGE = 300;
const MOST_TRIALS = 20;

function startRunsTable() {
  table.show = paged("runs-pages", ROWS_PER_PAGE, (rows) =>
    byId("runs").tBodies[0].replaceChildren(
      ...rows.map((row) => (row.element ??= makeRow(row))),
    ),
  );
  for (const [world, there] of runsOfWorld.entries()) {
    report.planners.forEach(({ name }, planner) => {
      const own = there.filter((run) => run.planner === planner);
      if (!own.length) return;
      const { index } = report.worlds[world];
      const row = { world, planner, name, index, runs: own };
      row.successes = own.filter((run) => !failed(run)).length;
      row.values = COLUMNS.map(([, value]) => value(row));
      table.rows.push(row);
    });
  }
  makeHead();
  const failures = [...new Set(runs.map((run) => run.failure).filter(Boolean))].sort();
  const kinds = [
    ["", "any"],
    ["all", "every trial at the goal"],
    ["some", "a trial failed"],
    ...failures.map((kind) => [`=${kind}`, `a trial failed: ${kind}`]),
    ["touched", "a trial touched an obstacle"],
  ];
  options(byId("filter-outcome"), kinds);
  const causes = [...new Set(runs.map((run) => run.cause).filter(Boolean))].sort();
  options(byId("filter-cause"), [
    ["", "any"],
    ...causes.map((cause) => [cause, cause]),
  ]);
  const planners = report.order.map((k) => [k, report.planners[k].name]);
  options(byId("filter-planner"), [["", "any"], ...planners]);
  for (const id of [
    "filter-text",
    "filter-planner",
    "filter-outcome",
    "filter-cause",
  ]) {
    for (const kind of ["input", "change"]) byId(id).addEventListener(kind, showRows);
  }
  onPlanners(showRows);
  showRows();
}

function makeHead() {
  const heads = COLUMNS.map(([title], k) => {
    const button = element("button", { type: "button" }, title);
    button.addEventListener("click", () => {
      table.descending = table.column === k && !table.descending;
      table.column = k;
      showRows();
    });
    return element(
      "th",
      { scope: "col", "data-metric": COLUMN_METRICS[title] },
      button,
    );
  });
  const plain = ["why it failed", "trials"].map((title) =>
    element("th", { scope: "col" }, element("span", { class: "plain" }, title)),
  );
  const head = byId("runs").tHead;
  head.replaceChildren(element("tr", {}, ...heads, ...plain));
}

function makeRow(row) {
  const cells = COLUMNS.map(([, , text], k) =>
    k === 1
      ? element("td", {}, swatch(row.planner), ` ${row.name}`)
      : element("td", {}, text(row.values[k], row)),
  );
  const buttons = shownTrials(row.runs).map((run) => {
    const outcome = failed(run) ? run.failure : `goal after ${seconds(run.time_s)}`;
    const button = element(
      "button",
      {
        type: "button",
        class: failed(run) ? "failed" : null,
        title: outcome,
        "aria-label": `Replay ${row.name} in world ${row.index}, trial ${run.trial}: ${outcome}`,
        disabled: run.recorded ? null : "",
      },
      String(run.trial),
    );
    button.addEventListener("click", () => showReplay(run));
    return button;
  });
  if (buttons.length < row.runs.length)
    buttons.push(element("span", {}, `of ${row.runs.length}`));
  const trials = element("td", {}, element("span", { class: "trials" }, ...buttons));
  const causes = makeCauses(row.runs.filter((run) => run.cause));
  const why = element("td", {}, element("span", { class: "causes" }, ...causes));
  return element("tr", {}, ...cells, why, trials);
}

/* Of many trials those that failed, then the others; those with a replay first. */
function shownTrials(there) {
  if (there.length <= MOST_TRIALS) return there;
  const worth = (run) => 2 * run.recorded + failed(run);
  return [...there]
    .sort((a, b) => worth(b) - worth(a) || a.trial - b.trial)
    .slice(0, MOST_TRIALS)
    .sort((a, b) => a.trial - b.trial);
}

/* A link for each; of many, one for each kind, with their number. */
function makeCauses(there) {
  if (there.length <= MOST_TRIALS) return there.map((run) => makeCause(run));
  const kinds = Map.groupBy(there, (run) => run.cause);
  return [...kinds.values()].map((own) =>
    makeCause(own.find((run) => run.recorded) ?? own[0], ` (${own.length} runs)`),
  );
}

/* A cause, which opens the replay at its moment. */
function makeCause(run, more = "") {
  const { name } = report.planners[run.planner];
  const { index } = report.worlds[run.world];
  const when = run.cause_s === null ? "" : ` at ${seconds(run.cause_s)}`;
  const button = element(
    "button",
    {
      type: "button",
      class: "link",
      title: `trial ${run.trial}`,
      "aria-label": `Replay ${name} in world ${index}, trial ${run.trial}: ${run.cause}${when}`,
      disabled: run.recorded ? null : "",
    },
    `${run.cause}${more || when}`,
  );
  button.addEventListener("click", () => showReplay(run, run.cause_s));
  return button;
}

/* What the filters let through, read once for all rows. */
function makeMatch() {
  const words = byId("filter-text")
    .value.trim()
    .toLowerCase()
    .split(/\s+/)
    .filter(Boolean);
  const planner = byId("filter-planner").value;
  const outcome = byId("filter-outcome").value;
  const cause = byId("filter-cause").value;
  const named = (row) => (word) =>
    /^\d+$/.test(word)
      ? String(row.index) === word
      : row.name.toLowerCase().includes(word);
  const ended = {
    "": () => true,
    all: (row) => row.successes === row.runs.length,
    some: (row) => row.successes < row.runs.length,
    touched: (row) => row.runs.some((run) => run.contacts > 0),
  };
  const fits =
    ended[outcome] ?? ((row) => row.runs.some((run) => `=${run.failure}` === outcome));
  return (row) =>
    isShown(row.planner) &&
    (planner === "" || row.planner === Number(planner)) &&
    (cause === "" || row.runs.some((run) => run.cause === cause)) &&
    words.every(named(row)) &&
    fits(row);
}

/* Unknown values come last, whichever way. */
function compareRows(a, b) {
  const [left, right] = [a.values[table.column], b.values[table.column]];
  if (left === null || right === null) return (left === null) - (right === null);
  return (left - right) * (table.descending ? -1 : 1);
}

function showRows() {
  const shown = table.rows.filter(makeMatch()).sort(compareRows);
  table.show(shown);
  byId("filter-count").textContent = `${shown.length} of ${table.rows.length} rows`;
  [...byId("runs").tHead.rows[0].cells].forEach((cell, k) => {
    if (k !== table.column) cell.removeAttribute("aria-sort");
    else cell.setAttribute("aria-sort", table.descending ? "descending" : "ascending");
  });
}
