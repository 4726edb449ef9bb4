/* Speed and yaw rate over the whole run, below the stage's controls. */

const STRIP_LEFT = 34;
const modeColour = (mode) => `var(--mode-${mode})`;

/* Both columns of the runs on the stage, and where we are. */
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
  const X = (time_s) => STRIP_LEFT + (time_s / duration()) * (width - STRIP_LEFT - 1);
  const middle = height * 0.5;
  drawPanel(pen, X, {
    top: 8,
    bottom: middle - 22,
    title: "speed [m/s]; thin: commanded",
    measured: "speed",
    commanded: "commandSpeed",
  });
  drawPanel(pen, X, {
    top: middle + 8,
    bottom: height - 22,
    title: "yaw rate [rad/s]",
    measured: "yawRate",
    commanded: "commandYawRate",
  });
  pen.fillStyle = resolve("var(--muted)");
  pen.textAlign = "right";
  pen.fillText(seconds(duration()), width, height - 8);
  pen.strokeStyle = resolve("var(--ink)");
  pen.lineWidth = 1.5;
  const now = X(replay.time_s);
  pen.beginPath();
  pen.moveTo(now, 4);
  pen.lineTo(now, height - 18);
  pen.stroke();
}

/* A column as measured and as commanded, over bands of modes and marks of contacts; of
   a run beside it as measured. */
function drawPanel(pen, X, { top, bottom, title, measured, commanded }) {
  const { trajectory, run, beside } = replay;
  const other = beside.trajectory?.ticks ? beside.trajectory : null;
  const columns = [
    trajectory[measured],
    trajectory[commanded],
    other?.[measured] ?? [],
  ];
  let [high, low] = [0.5, 0];
  for (const column of columns) {
    for (const value of column) {
      high = Math.max(high, value);
      low = Math.min(low, value);
    }
  }
  const Y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
  const right = X(duration());
  const at = (tick, of = trajectory) => X(tick * of.period_s);
  spans(trajectory.mode, (mode, from, to) => {
    if (!mode) return;
    pen.globalAlpha = 0.35;
    pen.fillStyle = resolve(modeColour(mode));
    pen.fillRect(at(from), top, at(to) - at(from), bottom - top);
    pen.globalAlpha = 1;
  });
  for (const [shown, height] of [
    [trajectory, 5],
    [other, 10],
  ]) {
    spans(shown?.touching ?? [], (touching, from, to) => {
      if (!touching) return;
      pen.fillStyle = resolve("var(--contact)");
      const wide = Math.max(at(to, shown) - at(from, shown), 2);
      pen.fillRect(at(from, shown), bottom - height, wide, 4);
    });
  }
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
  const line = (of, column, colour, width_px) => {
    pen.strokeStyle = resolve(colour);
    pen.lineWidth = width_px;
    pen.beginPath();
    column.forEach((value, k) => pen.lineTo(at(k, of), Y(value)));
    pen.stroke();
  };
  line(trajectory, columns[1], "var(--muted)", 0.8);
  if (other) {
    pen.setLineDash([5, 3]);
    line(other, columns[2], planColour(beside.run.planner), 1.5);
    pen.setLineDash([]);
  }
  line(trajectory, columns[0], planColour(run.planner), 1.8);
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
