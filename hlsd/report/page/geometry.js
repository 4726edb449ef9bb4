/* Worlds as circles, and rays against them in closed form. All in metres and radians. */

const cylindersCache = new Map();

/* Centres [x, y] of a world's cylinders; none where the suite is not at hand. */
function cylindersOf(world) {
  if (!cylindersCache.has(world)) cylindersCache.set(world, unpackWorld(world));
  return cylindersCache.get(world);
}

/* A world is a grid of bits, row by row, in hexadecimal: rows along +x, columns along
   +y. More cylinders stand around it, the same in every world. */
function unpackWorld(world) {
  const { grid, shape } = report.worlds[world];
  if (!grid) return [];
  const { origin_xy_m: origin, pitch_m: pitch, around_xy_m: around } = report.cylinders;
  const [rows, columns] = shape;
  const centres = [...around];
  for (let k = 0; k < rows * columns; k += 1) {
    const digit = Number.parseInt(grid[k >> 2], 16);
    if (digit & (8 >> (k & 3))) {
      const row = Math.floor(k / columns);
      centres.push([origin[0] + pitch * row, origin[1] + pitch * (k - columns * row)]);
    }
  }
  return centres;
}

/* A point of a frame, given in the frame that it stands in. */
function toWorld(pose, x, y) {
  const [cos, sin] = [Math.cos(pose.yaw), Math.sin(pose.yaw)];
  return [pose.x + cos * x - sin * y, pose.y + sin * x + cos * y];
}

/* The scan at a pose: where each beam ends, and its range; `null` ends: no return. */
function castScan(pose, cylinders) {
  const { beams, fov_rad: fov, max_range_m: far, min_range_m: near } = report.lidar;
  const { beam_step: step, mount_in_base_m: mount } = report.lidar;
  const [x, y] = toWorld(pose, mount[0], mount[1]);
  const radius = report.cylinders.radius_m;
  const close = cylinders
    .map(([cx, cy]) => [cx - x, cy - y])
    .filter(([dx, dy]) => Math.hypot(dx, dy) - radius < far);
  const rays = [];
  for (let beam = 0; beam < beams; beam += step) {
    const angle = pose.yaw - fov / 2 + (fov * beam) / (beams - 1);
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    let range = far;
    for (const [dx, dy] of close) {
      const along = dx * cos + dy * sin;
      const aside = dy * cos - dx * sin;
      const half = radius * radius - aside * aside;
      if (along > 0 && half > 0) range = Math.min(range, along - Math.sqrt(half));
    }
    range = Math.max(range, near);
    rays.push({ x: x + range * cos, y: y + range * sin, range, hit: range < far });
  }
  return { x, y, rays };
}
