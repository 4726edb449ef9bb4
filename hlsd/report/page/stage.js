/* The stage of the replay: the world from above, with one robot or two in it. */

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

/* Each run on the stage as it is now: the chosen one, then the one beside it. */
function robotsNow() {
  const found = [];
  for (const { run, trajectory } of [replay, replay.beside]) {
    if (!trajectory?.ticks) continue;
    const pose = poseAt(trajectory, replay.time_s);
    const moving = moversAt(run.world, trajectory, replay.time_s);
    const scan = castScan(pose, together(shapesOf(run.world), moving));
    const tick = tickOf(trajectory);
    const ended = replay.time_s >= lengthOf(trajectory) - 1e-6;
    const colour = planColour(run.planner);
    found.push({ run, trajectory, pose, moving, scan, tick, ended, colour });
  }
  return found;
}

function drawStage() {
  const { run } = replay;
  const robots = run ? robotsNow() : [];
  replay.robots = robots;
  const map = prepare(byId("stage"), stageView(robots[0]?.pose));
  showOutside([]);
  if (!run) return;
  drawWorld(map, run.world);
  if (!robots.length) return;
  if (byId("show-others").checked) drawOthers(map);
  robots.forEach((robot, k) => drawMovers(map, robot, k));
  if (byId("show-scan").checked) drawScan(map, robots[0].scan);
  for (const robot of robots) drawRun(map, robot);
  robots.forEach((robot, k) => {
    const { trajectory, tick } = robot;
    if (byId("show-goal").checked) drawLocalGoal(map, trajectory, tick);
    drawRobot(map, robot, k ? 0.55 : 0.85);
    if (robots.length > 1) drawLabel(map, robot, k ? 9 : -9);
  });
  const outside = robots.filter(({ pose }) => isOutside(map, pose));
  for (const robot of outside) drawArrow(map, robot);
  showOutside(outside.map((robot) => [robot, beyond(map, robot.pose).away_m]));
}

function drawOthers(map) {
  map.pen.globalAlpha = 0.35;
  for (const [other, track] of replay.others) {
    if (isShown(other.planner)) drawTrack(map, track, planColour(other.planner), 1.5);
  }
  map.pen.globalAlpha = 1;
}

/* Moving obstacles wait for robots, each for its own: those of the second run, where
   they differ, are outlines in its colour. */
function drawMovers(map, { run, trajectory, moving, colour }, k) {
  if (!k) {
    drawWays(map, run.world, trajectory, replay.time_s);
    fillShapes(map, moving, "var(--mover)");
    return;
  }
  map.pen.strokeStyle = resolve(colour);
  map.pen.lineWidth = 1.5;
  outlineShapes(map, moving);
  map.pen.stroke();
}

/* The path, the way so far and the rest of it, and what went wrong on it. */
function drawRun(map, { run, trajectory, tick, ended, colour }) {
  if (byId("show-path").checked) drawPath(map, pathAt(trajectory, tick));
  map.pen.globalAlpha = 0.35;
  drawTrack(map, trajectory, colour, 2);
  map.pen.globalAlpha = 1;
  drawTrack(map, trajectory, colour, 3, tick);
  drawMishaps(map, trajectory, run, 6, ended ? trajectory.ticks : tick);
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
function drawRobot(map, { pose, colour, trajectory, tick }, opacity) {
  const [mode, touching] = [trajectory.mode[tick], trajectory.touching[tick]];
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
  pen.globalAlpha = opacity;
  pen.fill();
  pen.globalAlpha = 1;
  pen.strokeStyle = resolve(touching ? "var(--contact)" : "var(--ink)");
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
  const corner = Math.hypot(length - rounding, width - rounding) + rounding;
  disc(map, pose.x, pose.y, (corner + 0.11) * scale);
  for (const [ring, width_px] of [
    ["var(--page)", 6],
    ["var(--contact)", 3],
  ]) {
    pen.strokeStyle = resolve(ring);
    pen.lineWidth = width_px;
    pen.stroke();
  }
}

/* Which of two robots it is, beside it: its planner, or its trial. */
function drawLabel(map, robot, below) {
  const { pen } = map;
  const aside = Math.hypot(report.robot.half_length_m, report.robot.half_width_m);
  const y = map.Y(robot.pose.y) + below;
  const text = shortName(robot.run);
  pen.font = "600 12px system-ui, sans-serif";
  pen.textBaseline = "middle";
  const room = pen.measureText(text).width + 8;
  const right = map.X(robot.pose.x) + aside * map.scale + 6;
  const fits = right + room < map.width;
  pen.textAlign = fits ? "left" : "right";
  const x = fits ? right : map.X(robot.pose.x) - aside * map.scale - 6;
  writeOver(pen, text, x, y, robot.colour);
}

function writeOver(pen, text, x, y, colour) {
  pen.lineJoin = "round";
  pen.lineWidth = 4;
  pen.strokeStyle = resolve("var(--page)");
  pen.strokeText(text, x, y);
  pen.fillStyle = resolve(colour);
  pen.fillText(text, x, y);
}

/* The planner of a run on the stage; its trial, where both are of one planner. */
function shortName(run) {
  const [one, other] = [replay.run, replay.beside.run];
  return other && one.planner === other.planner
    ? `trial ${run.trial}`
    : report.planners[run.planner].name;
}

/* ---- Robots that are not within the picture. */

const EDGE_PX = 24;

function isOutside(map, pose) {
  const [x, y] = [map.X(pose.x), map.Y(pose.y)];
  return x < 0 || y < 0 || x > map.width || y > map.height;
}

/* Where the edge is nearest to a pose outside, which way it lies, and how far off. */
function beyond(map, pose) {
  const [x, y] = [map.X(pose.x), map.Y(pose.y)];
  const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
  const edge = [clamp(x, 0, map.width), clamp(y, 0, map.height)];
  return {
    x: clamp(x, EDGE_PX, map.width - EDGE_PX),
    y: clamp(y, EDGE_PX, map.height - EDGE_PX),
    angle: Math.atan2(y - edge[1], x - edge[0]),
    away_m: Math.hypot(x - edge[0], y - edge[1]) / map.scale,
  };
}

/* An arrow at the edge towards it, and its distance. */
function drawArrow(map, robot) {
  const { pen } = map;
  const { x, y, angle, away_m: away } = beyond(map, robot.pose);
  pen.save();
  pen.translate(x, y);
  pen.rotate(angle);
  pen.beginPath();
  for (const [along, aside] of [
    [18, 0],
    [2, 11],
    [2, 4],
    [-14, 4],
    [-14, -4],
    [2, -4],
    [2, -11],
  ])
    pen.lineTo(along, aside);
  pen.closePath();
  pen.fillStyle = resolve(robot.colour);
  pen.strokeStyle = resolve("var(--ink)");
  pen.lineWidth = 1.5;
  pen.lineJoin = "round";
  pen.fill();
  pen.stroke();
  pen.restore();
  pen.font = "600 13px system-ui, sans-serif";
  pen.textBaseline = "middle";
  const left = x < map.width / 2;
  pen.textAlign = left ? "left" : "right";
  writeOver(pen, `${number(away, 1)} m`, x + (left ? 24 : -24), y, "var(--ink)");
}

/* Say it below the stage, too. */
function showOutside(outside) {
  const lines = outside.map(
    ([{ run }, away]) =>
      `${shortName(run)} is ${number(away, 1)} m outside the picture, where its arrow points.`,
  );
  byId("stage-off").textContent = lines.join(" ");
  byId("stage-off").hidden = !lines.length;
}
