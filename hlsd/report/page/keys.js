/* The replay by keys; the dialog says which. */

function startKeys() {
  byId("show-keys").addEventListener("click", () => byId("keys").showModal());
  byId("next-failure").addEventListener("click", () => showNeighbour(1, true));
  byId("previous-failure").addEventListener("click", () => showNeighbour(-1, true));
  document.addEventListener("keydown", pressed);
}

const KEYS = {
  "?": () => byId("keys").showModal(),
  "+": () => changeSpeed(1),
  "=": () => changeSpeed(1),
  "-": () => changeSpeed(-1),
  "−": () => changeSpeed(-1),
  n: () => showNeighbour(1, false),
  p: () => showNeighbour(-1, false),
  N: () => showNeighbour(1, true),
  P: () => showNeighbour(-1, true),
};

/* Those that scroll the page otherwise: for the replay only while it is in sight. */
const SCROLLING_KEYS = {
  " ": togglePlay,
  ArrowLeft: (event) => stepBy(event.shiftKey ? -1 : null, -1),
  ArrowRight: (event) => stepBy(event.shiftKey ? 1 : null, 1),
};

function pressed(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || byId("keys").open) return;
  const { target } = event;
  if (target.closest?.("select, textarea, input[type='search']")) return;
  let act = KEYS[event.key];
  if (!act && SCROLLING_KEYS[event.key] && isStageInSight()) {
    const busy = event.key === " " ? "button, summary, a, input" : "input, .scroll";
    if (!target.closest?.(busy)) act = SCROLLING_KEYS[event.key];
  }
  if (!act) return;
  event.preventDefault();
  act(event);
}

function isStageInSight() {
  const { top, bottom } = byId("stage").getBoundingClientRect();
  return bottom > 0 && top < innerHeight;
}

/* Some seconds on, or a step of the planner either way. */
function stepBy(seconds_s, way) {
  const { trajectory } = replay;
  if (!trajectory) return;
  pause();
  const { period_s } = trajectory;
  const tick = Math.round(replay.time_s / period_s) + way;
  seek(seconds_s === null ? tick * period_s : replay.time_s + seconds_s);
  noteSoon();
}

function changeSpeed(way) {
  const select = byId("speed");
  const last = select.options.length - 1;
  select.selectedIndex = Math.min(Math.max(select.selectedIndex + way, 0), last);
  saySoftly(`Speed ${select.selectedOptions[0].text}`);
}

/* The planner's next or previous run that can be replayed, by world and trial. */
function showNeighbour(way, failures) {
  const { run } = replay;
  if (!run) return;
  const there = runs
    .filter(
      (other) =>
        other.planner === run.planner &&
        other.recorded &&
        (!failures || failed(other)) &&
        way * (other.world - run.world || other.trial - run.trial) > 0,
    )
    .sort((a, b) => way * (a.world - b.world || a.trial - b.trial));
  if (there.length) {
    saySoftly("");
    load([there[0]]);
    if (!isStageInSight()) byId("replay").scrollIntoView();
    return;
  }
  const { name } = report.planners[run.planner];
  const which = way > 0 ? "after" : "before";
  saySoftly(`${name} has no ${failures ? "failure" : "run"} ${which} this one.`);
}
