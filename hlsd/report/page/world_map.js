/* A world from above on a canvas: +y up, in metres. */

/* Fit a canvas to its width and a view {x: [from, to], y}; what drawing on it needs. */
function prepare(canvas, view = report.view) {
  const {
    x: [left, right],
    y: [low, high],
  } = view;
  const width = canvas.clientWidth;
  const scale = width / (right - left);
  const height = scale * (high - low);
  const density = devicePixelRatio || 1;
  canvas.width = Math.round(width * density);
  canvas.height = Math.round(height * density);
  canvas.style.height = `${height}px`;
  const pen = canvas.getContext("2d");
  pen.setTransform(density, 0, 0, density, 0, 0);
  pen.clearRect(0, 0, width, height);
  return {
    pen,
    scale,
    width,
    height,
    X: (x) => (x - left) * scale,
    Y: (y) => (high - y) * scale,
  };
}

function disc({ pen, X, Y }, x, y, radius_px) {
  pen.beginPath();
  pen.arc(X(x), Y(y), radius_px, 0, 2 * Math.PI);
}

/* Circles and boxes, filled. */
function fillShapes(map, shapes, colour) {
  map.pen.fillStyle = resolve(colour);
  outlineShapes(map, shapes);
  map.pen.fill();
}

/* Circles and boxes, to be filled or drawn along. */
function outlineShapes({ pen, scale, X, Y }, { circles, boxes }) {
  pen.beginPath();
  for (const [x, y, radius] of circles) {
    pen.moveTo(X(x) + radius * scale, Y(y));
    pen.arc(X(x), Y(y), radius * scale, 0, 2 * Math.PI);
  }
  for (const [x, y, yaw, length, width] of boxes) {
    const corners = [
      [length, width],
      [-length, width],
      [-length, -width],
      [length, -width],
    ];
    corners.forEach(([a, b], k) => {
      const [cornerX, cornerY] = toWorld({ x, y, yaw }, a, b);
      if (k === 0) pen.moveTo(X(cornerX), Y(cornerY));
      else pen.lineTo(X(cornerX), Y(cornerY));
    });
    pen.closePath();
  }
}

/* What stands, start and goal. */
function drawWorld(map, world) {
  const { pen, scale } = map;
  fillShapes(map, shapesOf(world), "var(--obstacle)");
  const { start, goal } = report.worlds[world];
  if (!goal) return;
  pen.strokeStyle = pen.fillStyle = resolve("var(--goal)");
  pen.lineWidth = 1.5;
  pen.setLineDash([4, 3]);
  if (report.goal_box_m) {
    const half = report.goal_box_m;
    const [left, top] = [map.X(goal[0] - half), map.Y(goal[1] + half)];
    pen.strokeRect(left, top, 2 * half * scale, 2 * half * scale);
  } else {
    disc(map, goal[0], goal[1], report.goal_radius_m * scale);
    pen.stroke();
  }
  pen.setLineDash([]);
  disc(map, goal[0], goal[1], Math.max(2, 0.05 * scale));
  pen.fill();
  pen.strokeStyle = resolve("var(--muted)");
  disc(map, start[0], start[1], Math.max(2, 0.06 * scale));
  pen.stroke();
}

/* Where a robot drove, until a tick. */
function drawTrack(map, trajectory, colour, width_px, until = trajectory.ticks) {
  const { pen, X, Y } = map;
  pen.strokeStyle = resolve(colour);
  pen.lineWidth = width_px;
  pen.lineJoin = "round";
  pen.beginPath();
  for (let k = 0; k <= until; k += 1)
    pen.lineTo(X(trajectory.x[k]), Y(trajectory.y[k]));
  pen.stroke();
}

/* A dot where each contact began, until a tick; a cross where a failed run ended. */
function drawMishaps(map, trajectory, run, size_px, until = trajectory.ticks) {
  const { pen, X, Y } = map;
  pen.fillStyle = resolve(planColour(run.planner));
  pen.strokeStyle = resolve("var(--page)");
  pen.lineWidth = 1;
  for (let k = 0; k < until; k += 1) {
    if (trajectory.touching[k] && !(k && trajectory.touching[k - 1])) {
      disc(map, trajectory.x[k + 1], trajectory.y[k + 1], size_px * 0.7);
      pen.fill();
      pen.stroke();
    }
  }
  if (!failed(run) || until < trajectory.ticks) return;
  // Where it left the map, the cross is at the edge.
  const within = (value, end) =>
    Math.min(Math.max(value, size_px + 2), end - size_px - 2);
  const x = within(X(trajectory.x[until]), map.width);
  const y = within(Y(trajectory.y[until]), map.height);
  for (const [colour, width_px] of [
    ["var(--page)", 4],
    [planColour(run.planner), 2],
  ]) {
    pen.strokeStyle = resolve(colour);
    pen.lineWidth = width_px;
    pen.beginPath();
    for (const way of [1, -1]) {
      pen.moveTo(x - size_px, y - way * size_px);
      pen.lineTo(x + size_px, y + way * size_px);
    }
    pen.stroke();
  }
}
