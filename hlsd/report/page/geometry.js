/* Worlds as circles and boxes, and rays against them in closed form. All in metres and
   radians. */

const shapesCache = new Map();

/* What stands in a world: circles [x, y, radius] and boxes [x, y, yaw, half length, half
   width]; none where the suite is not at hand. */
function shapesOf(world) {
  if (!shapesCache.has(world)) shapesCache.set(world, unpackWorld(world));
  return shapesCache.get(world);
}

const isAtHand = (world) => Boolean(report.worlds[world].goal);

/* A world of shapes lists them. Any other is a grid of bits, row by row, in hexadecimal:
   rows along +x, columns along +y. More cylinders stand around it, the same in every
   world. */
function unpackWorld(world) {
  const { grid, shape, shapes } = report.worlds[world];
  if (shapes) return shapes;
  if (!grid) return { circles: [], boxes: [] };
  const { origin_xy_m: origin, pitch_m: pitch, around_xy_m: around } = report.cylinders;
  const radius = report.cylinders.radius_m;
  const [rows, columns] = shape;
  const circles = around.map(([x, y]) => [x, y, radius]);
  for (let k = 0; k < rows * columns; k += 1) {
    const digit = Number.parseInt(grid[k >> 2], 16);
    if (digit & (8 >> (k & 3))) {
      const row = Math.floor(k / columns);
      const y = origin[1] + pitch * (k - columns * row);
      circles.push([origin[0] + pitch * row, y, radius]);
    }
  }
  return { circles, boxes: [] };
}

/* A point of a frame, given in the frame that it stands in. */
function toWorld(pose, x, y) {
  const [cos, sin] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
  return [pose.x + cos * x - sin * y, pose.y + sin * x + cos * y];
}

/* The scan at a pose: where each beam ends, and its range; `null` ends: no return. */
function castScan(pose, { circles, boxes }) {
  const { beams, fov_rad: fov, max_range_m: far, min_range_m: near } = report.lidar;
  const { beam_step: step, mount_in_base_m: mount } = report.lidar;
  const [x, y] = toWorld(pose, mount[0], mount[1]);
  const close = circles
    .map(([cx, cy, radius]) => [cx - x, cy - y, radius])
    .filter(([dx, dy, radius]) => Math.hypot(dx, dy) - radius < far);
  const rays = [];
  for (let beam = 0; beam < beams; beam += step) {
    const angle = pose.yaw - fov / 2 + (fov * beam) / (beams - 1);
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    let range = far;
    for (const [dx, dy, radius] of close) {
      const along = dx * cos + dy * sin;
      const aside = dy * cos - dx * sin;
      const half = radius * radius - aside * aside;
      if (along > 0 && half > 0) range = Math.min(range, along - Math.sqrt(half));
    }
    for (const box of boxes) range = Math.min(range, rayToBox(x, y, cos, sin, box));
    range = Math.max(range, near);
    rays.push({ x: x + range * cos, y: y + range * sin, range, hit: range < far });
  }
  return { x, y, rays };
}

/* How far a ray goes until it enters a box; infinite where it does not. */
function rayToBox(x, y, cos, sin, [boxX, boxY, yaw, length, width]) {
  const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
  const [dx, dy] = [x - boxX, y - boxY];
  const from = [c * dx + s * dy, c * dy - s * dx];
  const along = [c * cos + s * sin, c * sin - s * cos];
  let [enter, leave] = [-Infinity, Infinity];
  [length, width].forEach((half, axis) => {
    const one = (-half - from[axis]) / along[axis];
    const other = (half - from[axis]) / along[axis];
    enter = Math.max(enter, Math.min(one, other));
    leave = Math.min(leave, Math.max(one, other));
  });
  return enter >= 0 && enter <= leave ? enter : Infinity;
}
