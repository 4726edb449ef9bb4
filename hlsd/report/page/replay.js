/* Any run again: robot, scan, local goal, global path and mode, at any time of it. */

const replay = {
  run: null,
  trajectory: null,
  others: [],
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
    report.planners.map(({ name }, k) => [k, name]),
  );
  const colours = report.modes.map((title, k) => [title, modeColour(k)]).slice(1);
  const moving = report.worlds.some(({ movers }) => movers?.length)
    ? [["moving obstacle", "var(--mover)"]]
    : [];
  byId("mode-keys").replaceChildren(
    ...[...colours, ["contact", "var(--bad)"], ...moving].map(([title, colour]) => {
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
  byId("play").addEventListener("click", () => (replay.playing ? pause() : play()));
  byId("slider").addEventListener("input", () => {
    pause();
    seek(byId("slider").value * (replay.trajectory?.period_s ?? 0));
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
  };
  strip.addEventListener("pointerdown", seekStrip);
  strip.addEventListener("pointermove", seekStrip);
  onRedraw(drawReplay);
  load(runs.filter((run) => run.recorded).slice(0, 1));
}

/* Show a world, of the chosen planner unless another is named, at a time, and go there. */
function showReplay({ world, planner, trial }, time_s = 0) {
  const there = runsOfWorld[world].filter((run) => isShown(run.planner));
  const wanted = planner ?? replay.run?.planner;
  const own = there.filter((run) => run.planner === wanted);
  const found = (own.length ? own : there).filter(
    (run) => trial === undefined || run.trial === trial,
  );
  load(found.length ? found : runsOfWorld[world], time_s ?? 0);
  byId("replay").scrollIntoView();
}

/* The runs of the chosen world and planner. */
function chosen() {
  const world = Number(byId("replay-world").value);
  const planner = Number(byId("replay-planner").value);
  return runsOfWorld[world].filter((run) => run.planner === planner);
}

/* Load the first of some runs that was kept, at a time, or else say that none was. */
async function load(candidates, time_s = 0) {
  pause();
  const run = candidates.find((candidate) => candidate.recorded) ?? candidates[0];
  replay.run = run ?? null;
  replay.trajectory = null;
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
  showVerdict(run);
  const note = byId("stage-note");
  note.hidden = Boolean(run?.recorded);
  note.textContent = run
    ? leftOut
      ? "This run's replay is not on this page; above it says how to get it."
      : "No trajectory of this run was kept."
    : "There is no such run.";
  byId("play").disabled = byId("slider").disabled = !run?.recorded;
  if (run?.recorded) {
    const kept = runsOfWorld[run.world].filter((other) => other.recorded);
    const trajectories = await Promise.all(kept.map(trajectoryOf));
    if (replay.run !== run) return; // another was chosen meanwhile
    replay.others = kept.map((other, k) => [other, trajectories[k]]);
    replay.trajectory = trajectories[kept.indexOf(run)];
    byId("slider").max = replay.trajectory.ticks;
    replay.time_s = Math.min(time_s, duration());
  }
  drawReplay();
}

function showVerdict(run) {
  const verdict = byId("verdict");
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

const duration = () => replay.trajectory.ticks * replay.trajectory.period_s;

function tickNow() {
  const { trajectory, time_s } = replay;
  return Math.min(
    Math.floor(time_s / trajectory.period_s + 1e-6),
    trajectory.ticks - 1,
  );
}

function seek(time_s) {
  replay.time_s = time_s;
  drawReplay();
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
    seek(Math.min(replay.time_s + passed_s * Number(byId("speed").value), duration()));
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

const FOLLOWED_M = 6;

/* What the stage shows: all, or half of it around the robot, and of a large world less. */
function stageView(pose) {
  const { x, y } = report.view;
  if (!pose || !byId("follow").checked) return report.view;
  const largest = Math.max(x[1] - x[0], y[1] - y[0]);
  const share = Math.min(0.5, FOLLOWED_M / largest);
  const around = (at, [from, to]) => {
    const half = (share * (to - from)) / 2;
    return [at - half, at + half];
  };
  return { x: around(pose.x, x), y: around(pose.y, y) };
}

function drawStage() {
  const { run, trajectory } = replay;
  const pose = trajectory?.ticks ? poseAt(trajectory, replay.time_s) : null;
  const map = prepare(byId("stage"), stageView(pose));
  if (!run) return;
  drawWorld(map, run.world);
  if (!pose) return;
  const { pen } = map;
  const tick = tickNow();
  if (byId("show-others").checked) {
    pen.globalAlpha = 0.35;
    for (const [other, track] of replay.others) {
      if (isShown(other.planner)) drawTrack(map, track, planColour(other.planner), 1.5);
    }
    pen.globalAlpha = 1;
  }
  const moving = moversAt(run.world, trajectory, replay.time_s);
  drawWays(map, run.world, trajectory, replay.time_s);
  fillShapes(map, moving, "var(--mover)");
  replay.scan = castScan(pose, together(shapesOf(run.world), moving));
  if (byId("show-scan").checked) drawScan(map, replay.scan);
  if (byId("show-path").checked) drawPath(map, pathAt(trajectory, tick));
  pen.globalAlpha = 0.35;
  drawTrack(map, trajectory, planColour(run.planner), 2);
  pen.globalAlpha = 1;
  drawTrack(map, trajectory, planColour(run.planner), 3, tick);
  const atEnd = replay.time_s >= duration() - 1e-6;
  drawMishaps(map, trajectory, run, 6, atEnd ? trajectory.ticks : tick);
  if (byId("show-goal").checked) drawLocalGoal(map, trajectory, tick);
  drawRobot(
    map,
    pose,
    planColour(run.planner),
    trajectory.mode[tick],
    trajectory.touching[tick],
  );
}

function drawScan({ pen, X, Y }, { x, y, rays }) {
  pen.fillStyle = resolve("var(--scan)");
  pen.globalAlpha = 0.12;
  pen.beginPath();
  pen.moveTo(X(x), Y(y));
  for (const ray of rays) pen.lineTo(X(ray.x), Y(ray.y));
  pen.closePath();
  pen.fill();
  pen.globalAlpha = 1;
  for (const ray of rays) {
    if (ray.hit) pen.fillRect(X(ray.x) - 1.2, Y(ray.y) - 1.2, 2.4, 2.4);
  }
}

function drawPath({ pen, X, Y }, path) {
  if (!path) return;
  pen.strokeStyle = resolve("var(--path)");
  pen.lineWidth = 2;
  pen.setLineDash([6, 4]);
  pen.beginPath();
  path.x.forEach((x, k) => pen.lineTo(X(x), Y(path.y[k])));
  pen.stroke();
  pen.setLineDash([]);
}

/* The local goal as it was told in this tick, from the pose of the tick. */
function drawLocalGoal(map, trajectory, tick) {
  const at = {
    x: trajectory.x[tick],
    y: trajectory.y[tick],
    yaw: trajectory.yaw[tick],
  };
  const [x, y] = toWorld(at, trajectory.goalX[tick], trajectory.goalY[tick]);
  const { pen } = map;
  pen.fillStyle = resolve("var(--path)");
  pen.strokeStyle = resolve("var(--card)");
  pen.lineWidth = 2;
  disc(map, x, y, 6);
  pen.fill();
  pen.stroke();
}

/* Corners of a rectangle around the origin, each an arc of eight lines where rounded. */
function roundedRectangle(length, width, rounding) {
  const steps = rounding ? [...Array(9).keys()] : [0];
  return [0, 1, 2, 3].flatMap((quarter) => {
    const x = (quarter === 0 || quarter === 3 ? 1 : -1) * (length - rounding);
    const y = (quarter < 2 ? 1 : -1) * (width - rounding);
    return steps.map((step) => {
      const turn = (quarter + step / 8) * (Math.PI / 2);
      return [x + rounding * Math.cos(turn), y + rounding * Math.sin(turn)];
    });
  });
}

/* The robot's outline to scale, an arrow where it heads; a ring while it touches. */
function drawRobot(map, pose, colour, mode, touching) {
  const { pen, scale, X, Y } = map;
  const { half_length_m: length, half_width_m: width } = report.robot;
  const rounding = report.robot.corner_radius_m;
  const outline = (corners) => {
    pen.beginPath();
    for (const [x, y] of corners)
      pen.lineTo(...[toWorld(pose, x, y)].flatMap(([a, b]) => [X(a), Y(b)]));
    pen.closePath();
  };
  outline(roundedRectangle(length, width, rounding));
  pen.fillStyle = resolve(mode ? modeColour(mode) : colour);
  pen.globalAlpha = 0.85;
  pen.fill();
  pen.globalAlpha = 1;
  pen.strokeStyle = resolve(touching ? "var(--bad)" : "var(--ink)");
  pen.lineWidth = touching ? 3.5 : 1.5;
  pen.stroke();
  outline([
    [0.7 * length, 0],
    [-0.2 * length, 0.5 * width],
    [-0.2 * length, -0.5 * width],
  ]);
  pen.fillStyle = resolve("var(--card)");
  pen.fill();
  if (!touching) return;
  pen.lineWidth = 2;
  const corner = Math.hypot(length - rounding, width - rounding) + rounding;
  disc(map, pose.x, pose.y, (corner + 0.11) * scale);
  pen.stroke();
}

const STRIP_LEFT = 34;
const modeColour = (mode) => `var(--mode-${mode})`;

/* Speed and yaw rate over the whole run, and where we are. */
function drawStrip() {
  const canvas = byId("strip");
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const density = devicePixelRatio || 1;
  canvas.width = Math.round(width * density);
  canvas.height = Math.round(height * density);
  const pen = canvas.getContext("2d");
  pen.setTransform(density, 0, 0, density, 0, 0);
  const { trajectory } = replay;
  if (!trajectory || !trajectory.ticks) return;
  pen.font = "12px system-ui, sans-serif";
  const X = (tick) => STRIP_LEFT + (tick / trajectory.ticks) * (width - STRIP_LEFT - 1);
  const middle = height * 0.5;
  const { speed, commandSpeed, yawRate, commandYawRate } = trajectory;
  drawPanel(
    pen,
    X,
    [8, middle - 22],
    "speed [m/s]; thin: commanded",
    speed,
    commandSpeed,
  );
  drawPanel(
    pen,
    X,
    [middle + 8, height - 22],
    "yaw rate [rad/s]",
    yawRate,
    commandYawRate,
  );
  pen.fillStyle = resolve("var(--muted)");
  pen.textAlign = "right";
  pen.fillText(seconds(duration()), width, height - 8);
  pen.strokeStyle = resolve("var(--ink)");
  pen.lineWidth = 1.5;
  const now = X(replay.time_s / trajectory.period_s);
  pen.beginPath();
  pen.moveTo(now, 4);
  pen.lineTo(now, height - 18);
  pen.stroke();
}

/* A column as measured and as commanded, over bands of modes and marks of contacts. */
function drawPanel(pen, X, [top, bottom], title, measured, commanded) {
  const { trajectory, run } = replay;
  const values = [...measured, ...commanded];
  const high = Math.max(0.5, ...values);
  const low = Math.min(0, ...values);
  const Y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
  const right = X(trajectory.ticks);
  spans(trajectory.mode, (mode, from, to) => {
    if (!mode) return;
    pen.globalAlpha = 0.35;
    pen.fillStyle = resolve(modeColour(mode));
    pen.fillRect(X(from), top, X(to) - X(from), bottom - top);
    pen.globalAlpha = 1;
  });
  spans(trajectory.touching, (touching, from, to) => {
    if (!touching) return;
    pen.fillStyle = resolve("var(--bad)");
    pen.fillRect(X(from), bottom - 4, Math.max(X(to) - X(from), 2), 4);
  });
  pen.lineWidth = 1;
  pen.textBaseline = "middle";
  for (const value of ticks(low, high, 3)) {
    pen.fillStyle = resolve("var(--muted)");
    pen.textAlign = "right";
    pen.fillText(String(value), STRIP_LEFT - 6, Y(value));
    pen.strokeStyle = resolve(value === 0 ? "var(--muted)" : "var(--grid)");
    pen.beginPath();
    pen.moveTo(STRIP_LEFT, Y(value));
    pen.lineTo(right, Y(value));
    pen.stroke();
  }
  pen.fillStyle = resolve("var(--muted)");
  pen.textAlign = "left";
  pen.fillText(title, STRIP_LEFT, bottom + 14);
  const line = (column, colour, width_px) => {
    pen.strokeStyle = resolve(colour);
    pen.lineWidth = width_px;
    pen.beginPath();
    column.forEach((value, k) => pen.lineTo(X(k), Y(value)));
    pen.stroke();
  };
  line(commanded, "var(--muted)", 0.8);
  line(measured, planColour(run.planner), 1.8);
}

/* Call back with each stretch of equal values: value, first tick, tick after the last. */
function spans(column, tell) {
  let from = 0;
  for (let k = 1; k <= column.length; k += 1) {
    if (k < column.length && column[k] === column[from]) continue;
    tell(column[from], from, k);
    from = k;
  }
}

function showReadout() {
  const { trajectory } = replay;
  const write = (id, text, alarm = false) => {
    byId(id).textContent = text;
    byId(id).classList.toggle("alarm", alarm);
  };
  if (!trajectory || !trajectory.ticks) {
    for (const name of ["time", "speed", "yaw-rate", "mode", "nearest", "contact"]) {
      write(`read-${name}`, "–");
    }
    return;
  }
  const tick = tickNow();
  const at = `${number(replay.time_s, 2)} of ${seconds(duration())}`;
  const near = Math.min(...replay.scan.rays.map((ray) => ray.range));
  write("read-time", at);
  write("read-speed", `${number(trajectory.speed[tick], 2)} m/s`);
  write("read-yaw-rate", `${number(trajectory.yawRate[tick], 2)} rad/s`);
  write("read-mode", report.modes[trajectory.mode[tick]] ?? "unknown");
  write("read-nearest", isAtHand(replay.run.world) ? `${number(near, 2)} m` : "–");
  write(
    "read-contact",
    trajectory.touching[tick] ? "touching" : "none",
    trajectory.touching[tick],
  );
  const slider = byId("slider");
  slider.value = Math.round(replay.time_s / trajectory.period_s);
  slider.setAttribute("aria-valuetext", at);
}
