/* Trajectories: the layout is written down in hlsd/run/trajectory.py. */

const FORMAT = 1;
const WITH_MOVERS = 2;
const decoded = new Map();

/* The trajectory of a run, a promise; decoded once. */
function trajectoryOf(run) {
  if (!decoded.has(run.id)) decoded.set(run.id, decode(trajectoryLines[run.id]));
  return decoded.get(run.id);
}

async function decode(line) {
  const packed = Uint8Array.from(atob(line), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream();
  const inflated = stream.pipeThrough(new DecompressionStream("deflate"));
  return unpack(await new Response(inflated).arrayBuffer());
}

function unpack(buffer) {
  const head = new DataView(buffer);
  const bytes = new Uint8Array(buffer);
  const format = head.getUint16(0, true);
  if (format !== FORMAT && format !== WITH_MOVERS)
    throw new Error(`trajectory of format ${format}`);
  const paths = head.getUint16(2, true);
  const ticks = head.getUint32(4, true);
  const period_s = head.getFloat64(8, true);
  let at = 16;

  /* Low bytes, then high bytes, of zigzag differences that wrap at 16 bits. */
  function column(count, unit) {
    const values = new Float64Array(count);
    const whole = new Int16Array(1);
    for (let k = 0; k < count; k += 1) {
      const word = bytes[at + k] | (bytes[at + count + k] << 8);
      whole[0] += word & 1 ? ~(word >> 1) : word >> 1;
      values[k] = whole[0] * unit;
    }
    at += 2 * count;
    return values;
  }
  function plain(count) {
    at += count;
    return bytes.subarray(at - count, at);
  }

  const trajectory = {
    period_s,
    ticks,
    x: column(ticks + 1, 0.001),
    y: column(ticks + 1, 0.001),
    yaw: column(ticks + 1, 0.001),
    commandSpeed: column(ticks, 0.01),
    commandYawRate: column(ticks, 0.01),
    speed: column(ticks, 0.01),
    yawRate: column(ticks, 0.01),
    goalX: column(ticks, 0.01),
    goalY: column(ticks, 0.01),
    mode: plain(ticks),
    touching: plain(ticks),
    paths: [],
    moversBegin_s: 0,
    waited: [],
  };
  const starts = column(paths, 1);
  const counts = column(paths, 1);
  const total = counts.reduce((sum, count) => sum + count, 0);
  const [x, y] = [column(total, 0.01), column(total, 0.01)];
  let first = 0;
  starts.forEach((tick, k) => {
    const end = first + counts[k];
    trajectory.paths.push({
      tick,
      x: x.subarray(first, end),
      y: y.subarray(first, end),
    });
    first = end;
  });
  if (format === WITH_MOVERS) {
    trajectory.moversBegin_s = head.getFloat64(at, true);
    const movers = head.getUint32(at + 8, true);
    at += 12;
    for (let k = 0; k < movers; k += 1) trajectory.waited.push(column(ticks + 1, 0.01));
  }
  return trajectory;
}

/* The pose at a time, between two ticks on the straight line; turns go the short way. */
function poseAt(trajectory, time_s) {
  const last = trajectory.ticks;
  const place = Math.min(Math.max(time_s / trajectory.period_s, 0), last);
  const k = Math.min(Math.floor(place), Math.max(last - 1, 0));
  const next = Math.min(k + 1, last);
  const part = place - k;
  const between = (column) => column[k] + part * (column[next] - column[k]);
  const turn = trajectory.yaw[next] - trajectory.yaw[k];
  const short = Math.atan2(Math.sin(turn), Math.cos(turn));
  return {
    x: between(trajectory.x),
    y: between(trajectory.y),
    yaw: trajectory.yaw[k] + part * short,
  };
}

/* The global path that was followed in a tick; null before the first. */
function pathAt(trajectory, tick) {
  let found = null;
  for (const path of trajectory.paths) if (path.tick <= tick) found = path;
  return found;
}
