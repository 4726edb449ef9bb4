/* What the page shows: the numbers of the report, and its runs by world and planner. */

const report = JSON.parse(document.getElementById("report-data").textContent);

/* One line of base64 per run, empty where no trajectory was kept. */
const trajectoryLines = document
  .getElementById("report-trajectories")
  .textContent.trim()
  .split("\n");

/* The runs, from columns to objects; `id` is the row. */
const runs = report.runs.world.map((world, id) => {
  const run = { id };
  for (const [name, column] of Object.entries(report.runs)) run[name] = column[id];
  run.recorded = Boolean(trajectoryLines[id]);
  return run;
});

/* Runs by index of the world, in the order of planners and trials. */
const runsOfWorld = report.worlds.map(() => []);
for (const run of runs) runsOfWorld[run.world].push(run);

/* Whether some runs' trajectories are not on the page. */
const leftOut = Boolean(document.getElementById("replays-left-out"));

const failed = (run) => run.failure !== "";

/* Elements by id, and new ones. */
const byId = (id) => document.getElementById(id);

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

function options(select, entries) {
  select.replaceChildren(
    ...entries.map(([value, text]) => element("option", { value }, text)),
  );
}

/* Planner k's colour for CSS; `resolve` of theme.js gives it to canvases. */
const planColour = (k) => `var(--planner-${k})`;

function swatch(k) {
  const dot = element("span", { class: "swatch", "aria-hidden": "true" });
  dot.style.setProperty("--colour", planColour(k));
  return dot;
}

const number = (value, decimals) =>
  value === null || value === undefined ? "–" : value.toFixed(decimals);
