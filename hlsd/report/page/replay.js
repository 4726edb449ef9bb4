/* Any run again: robot, scan, local goal, global path and mode, at any time of it. */

const replay = {
  run: null,
  trajectory: null,
  beside: { run: null, trajectory: null },
  others: [],
  robots: [],
  time_s: 0,
  playing: false,
  frame: null,
};

function startReplay() {
  options(
    byId("replay-world"),
    report.worlds.map(({ index }, k) => [k, String(index)]),
  );
  options(
    byId("replay-planner"),
    report.order.map((k) => [k, report.planners[k].name]),
  );
  const colours = report.modes.map((title, k) => [title, modeColour(k)]).slice(1);
  const moving = report.worlds.some(({ movers }) => movers?.length)
    ? [["moving obstacle", "var(--mover)"]]
    : [];
  byId("mode-keys").replaceChildren(
    ...[...colours, ["contact", "var(--contact)"], ...moving].map(([title, colour]) => {
      const key = element("span", { class: "key" });
      key.style.setProperty("--colour", colour);
      return element("li", {}, key, title);
    }),
  );
  for (const id of ["replay-world", "replay-planner"]) {
    byId(id).addEventListener("change", () => load(chosen()));
  }
  byId("replay-trial").addEventListener("change", () => {
    load(chosen().filter((run) => run.trial === Number(byId("replay-trial").value)));
  });
  byId("play").addEventListener("click", togglePlay);
  byId("slider").addEventListener("input", () => {
    pause();
    seek(byId("slider").value * (replay.trajectory?.period_s ?? 0));
    noteSoon();
  });
  for (const id of ["show-scan", "show-path", "show-goal", "show-others", "follow"]) {
    byId(id).addEventListener("change", drawReplay);
  }
  const strip = byId("strip");
  const seekStrip = (event) => {
    if (!replay.trajectory || (event.type === "pointermove" && !event.buttons)) return;
    const box = strip.getBoundingClientRect();
    const share = (event.clientX - box.left - STRIP_LEFT) / (box.width - STRIP_LEFT);
    pause();
    seek(Math.min(Math.max(share, 0), 1) * duration());
    noteSoon();
  };
  strip.addEventListener("pointerdown", seekStrip);
  strip.addEventListener("pointermove", seekStrip);
  onRedraw(drawReplay);
  startBeside();
  startMoments();
}

/* The run that is shown before any is chosen. */
const loadFirst = () =>
  load(runs.filter((run) => run.recorded).slice(0, 1), { noted: false });

/* Show a world, of the chosen planner unless another is named, at a time, and go there. */
function showReplay({ world, planner, trial }, time_s = 0) {
  const there = runsOfWorld[world].filter((run) => isShown(run.planner));
  const wanted = planner ?? replay.run?.planner;
  const own = there.filter((run) => run.planner === wanted);
  const found = (own.length ? own : there).filter(
    (run) => trial === undefined || run.trial === trial,
  );
  load(found.length ? found : runsOfWorld[world], { time_s: time_s ?? 0 });
  byId("replay").scrollIntoView();
}

/* The runs of the chosen world and planner. */
function chosen() {
  const world = Number(byId("replay-world").value);
  const planner = Number(byId("replay-planner").value);
  return runsOfWorld[world].filter((run) => run.planner === planner);
}

/* Load the first of some runs that was kept, at a time, or else say that none was; with
   another beside it, or what is beside it now, in its new world. */
async function load(candidates, { time_s = 0, beside, noted = true } = {}) {
  pause();
  const run = candidates.find((candidate) => candidate.recorded) ?? candidates[0];
  const other = beside === undefined ? besideIn(run) : beside;
  replay.run = run ?? null;
  replay.trajectory = null;
  replay.beside = { run: other, trajectory: null };
  replay.others = [];
  replay.time_s = 0;
  if (run) {
    byId("replay-world").value = run.world;
    byId("replay-planner").value = run.planner;
    const trials = chosen().map(({ trial, recorded }) => [
      trial,
      recorded || !leftOut ? String(trial) : `${trial} (no replay)`,
    ]);
    options(byId("replay-trial"), trials);
    byId("replay-trial").value = run.trial;
    markMap(run.world);
  } else {
    byId("replay-trial").replaceChildren();
  }
  offerBeside(run, other);
  showVerdict(byId("verdict"), run);
  showVerdict(byId("verdict-beside"), other);
  const note = byId("stage-note");
  note.hidden = Boolean(run?.recorded);
  note.textContent = run
    ? leftOut
      ? "This run's replay is not on this page; above it says how to get it."
      : "No trajectory of this run was kept."
    : "There is no such run.";
  byId("play").disabled = byId("slider").disabled = !run?.recorded;
  if (run?.recorded) {
    const kept = runsOfWorld[run.world].filter((held) => held.recorded);
    const trajectories = await Promise.all(kept.map(trajectoryOf));
    if (replay.run !== run || replay.beside.run !== other) return; // another was chosen
    replay.others = kept.map((held, k) => [held, trajectories[k]]);
    replay.beside.trajectory = trajectories[kept.indexOf(other)] ?? null;
    replay.trajectory = trajectories[kept.indexOf(run)];
    byId("slider").max = Math.ceil(duration() / replay.trajectory.period_s - 1e-6);
    replay.time_s = Math.min(Math.max(time_s, 0), duration());
  }
  drawReplay();
  if (noted && run) noteMoment("push");
}

function showVerdict(verdict, run) {
  verdict.hidden = !run;
  if (!run) {
    verdict.replaceChildren();
    return;
  }
  const touches = run.contacts
    ? `${run.contacts} contact${run.contacts > 1 ? "s" : ""}`
    : "";
  const words = failed(run)
    ? element("span", { class: "failed" }, `failed: ${run.failure}`)
    : element("span", { class: "reached" }, `goal after ${seconds(run.time_s)}`);
  const more = [run.reason, touches].filter(Boolean).join(", ");
  const why = run.cause ? [makeCause(run)] : [];
  verdict.replaceChildren(
    swatch(run.planner),
    report.planners[run.planner].name,
    words,
    ...why,
    element("span", { class: "more" }, more),
  );
}

/* One clock runs for the robots on the stage, until the last of them has ended. */
const lengthOf = (trajectory) =>
  trajectory ? trajectory.ticks * trajectory.period_s : 0;
const duration = () =>
  Math.max(lengthOf(replay.trajectory), lengthOf(replay.beside.trajectory));

function tickOf(trajectory) {
  return Math.min(
    Math.floor(replay.time_s / trajectory.period_s + 1e-6),
    trajectory.ticks - 1,
  );
}

function seek(time_s) {
  replay.time_s = Math.min(Math.max(time_s, 0), duration());
  drawReplay();
}

function togglePlay() {
  if (replay.playing) {
    pause();
    noteSoon();
  } else play();
}

function play() {
  if (!replay.trajectory) return;
  if (replay.time_s >= duration() - 1e-6) replay.time_s = 0;
  replay.playing = true;
  showPlaying();
  let before = null;
  const step = (now) => {
    if (!replay.playing) return;
    const passed_s = before === null ? 0 : (now - before) / 1000;
    before = now;
    seek(replay.time_s + passed_s * Number(byId("speed").value));
    if (replay.time_s >= duration()) pause();
    else replay.frame = requestAnimationFrame(step);
  };
  replay.frame = requestAnimationFrame(step);
}

function pause() {
  replay.playing = false;
  cancelAnimationFrame(replay.frame);
  showPlaying();
}

function showPlaying() {
  byId("play").classList.toggle("playing", replay.playing);
  byId("play").setAttribute("aria-label", replay.playing ? "Pause" : "Play");
}

function drawReplay() {
  drawStage();
  drawStrip();
  showReadout();
}

/* What each robot on the stage does now. */
const READOUT = {
  speed: ({ trajectory, tick }) => `${number(trajectory.speed[tick], 2)} m/s`,
  "yaw-rate": ({ trajectory, tick }) => `${number(trajectory.yawRate[tick], 2)} rad/s`,
  mode: ({ trajectory, tick }) => report.modes[trajectory.mode[tick]] ?? "unknown",
  nearest: ({ run, scan }) => {
    const near = scan.rays.reduce(
      (least, { range }) => Math.min(least, range),
      Infinity,
    );
    return isAtHand(run.world) ? `${number(near, 2)} m` : "–";
  },
  contact: ({ trajectory, tick }) => (trajectory.touching[tick] ? "touching" : "none"),
};

function showReadout() {
  const { robots, trajectory } = replay;
  const there = robots.length > 0 && trajectory?.ticks;
  for (const [name, read] of Object.entries(READOUT)) {
    const values = there
      ? robots.map((robot) => {
          const text = read(robot);
          const alarm = text === "touching" ? "alarm" : null;
          const dots = robots.length > 1 ? [swatch(robot.run.planner), " "] : [];
          return element("span", { class: alarm }, ...dots, text);
        })
      : ["–"];
    byId(`read-${name}`).replaceChildren(...values);
  }
  if (!there) {
    byId("read-time").textContent = "–";
    return;
  }
  const at = `${number(replay.time_s, 2)} of ${seconds(duration())}`;
  byId("read-time").textContent = at;
  const slider = byId("slider");
  slider.value = Math.round(replay.time_s / trajectory.period_s);
  slider.setAttribute("aria-valuetext", at);
}
