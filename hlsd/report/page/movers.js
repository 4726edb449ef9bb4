/* Moving obstacles: tracks of key frames as in hlsd/data/tracks.py. */

/* Where a track is at a time: keys [t, x, y], joined by curves or by lines. */
function placeOn({ keys, curved }, time_s) {
  const last = keys.length - 1;
  const length = keys[last][0];
  if (!(length > 0)) return keys[0].slice(1);
  const now = time_s - Math.floor(time_s / length) * length;
  let k = 0;
  while (k + 1 < last && keys[k + 1][0] <= now) k += 1;
  const u = (now - keys[k][0]) / (keys[k + 1][0] - keys[k][0]);
  return [1, 2].map((axis) => {
    const [a, b] = [keys[k][axis], keys[k + 1][axis]];
    if (!curved) return a + u * (b - a);
    const leaving = tangent(keys, k, axis);
    const arriving = tangent(keys, k + 1, axis);
    return (
      (2 * u ** 3 - 3 * u ** 2 + 1) * a +
      (u ** 3 - 2 * u ** 2 + u) * leaving +
      (3 * u ** 2 - 2 * u ** 3) * b +
      (u ** 3 - u ** 2) * arriving
    );
  });
}

/* Half the way between a key's neighbours; across the seam of a closed track. */
function tangent(keys, k, axis) {
  const last = keys.length - 1;
  if (k > 0 && k < last) return (keys[k + 1][axis] - keys[k - 1][axis]) / 2;
  const closed = keys[0][1] === keys[last][1] && keys[0][2] === keys[last][2];
  if (closed) return (keys[1][axis] - keys[last - 1][axis]) / 2;
  return k === 0
    ? (keys[1][axis] - keys[0][axis]) / 2
    : (keys[last][axis] - keys[last - 1][axis]) / 2;
}

/* What a mover's clock reads at a time of a run. */
function clockOf(trajectory, mover, time_s) {
  const waited = trajectory.waited[mover] ?? [0];
  const tick = Math.floor(time_s / trajectory.period_s + 1e-6);
  return trajectory.moversBegin_s + time_s - waited[Math.min(tick, waited.length - 1)];
}

/* The movers of a world, as circles and boxes, where they are at a time of a run. */
function moversAt(world, trajectory, time_s) {
  const found = { circles: [], boxes: [] };
  (report.worlds[world].movers ?? []).forEach((mover, k) => {
    const [x, y] = placeOn(mover, clockOf(trajectory, k, time_s));
    if (mover.radius) found.circles.push([x, y, mover.radius]);
    else found.boxes.push([x, y, mover.yaw, ...mover.half_size]);
  });
  return found;
}

const together = (one, other) => ({
  circles: [...one.circles, ...other.circles],
  boxes: [...one.boxes, ...other.boxes],
});

/* The way of each mover in the next seconds, faint, until it jumps. */
function drawWays({ pen, X, Y }, world, trajectory, time_s) {
  pen.strokeStyle = resolve("var(--mover)");
  pen.globalAlpha = 0.45;
  pen.lineWidth = 1.5;
  pen.setLineDash([2, 4]);
  (report.worlds[world].movers ?? []).forEach((mover, k) => {
    const length = mover.keys[mover.keys.length - 1][0];
    const clock = clockOf(trajectory, k, time_s);
    const now = length > 0 ? clock - Math.floor(clock / length) * length : 0;
    pen.beginPath();
    for (let ahead = 0; ahead <= WAY_S && now + ahead < length; ahead += 0.1) {
      const [x, y] = placeOn(mover, now + ahead);
      pen.lineTo(X(x), Y(y));
    }
    pen.stroke();
  });
  pen.setLineDash([]);
  pen.globalAlpha = 1;
}

const WAY_S = 2;
