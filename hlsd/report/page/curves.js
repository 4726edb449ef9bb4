/* The three plots over all runs: difficulty, profiles, what came first. */

const seconds = (value) => `${number(value, 2)} s`;
const percent = (value) => `${Math.round(100 * value)} %`;
const shownOf = (entries) =>
  report.order
    .filter(isShown)
    .flatMap((k) => entries.filter(({ planner }) => planner === k));

function startRegression() {
  const { orders } = report.regression;
  if (!byId("regression")) return; // one world has no order
  options(
    byId("order"),
    orders.map((order, k) => [k, order.title]),
  );
  byId("order").addEventListener("change", drawRegression);
  onRedraw(drawRegression);
  onPlanners(drawRegression);
}

const ORDER_SAID = {
  sorted:
    "Each planner's mean times of the worlds, sorted from its fastest world to its " +
    "slowest, failures at the limit. Click a curve to replay that world.",
  lines:
    "The paper's plot: a dot is a planner's mean time in a world, failures at the " +
    "limit; lines are linear regressions, bands their 95 % intervals from resampling " +
    "worlds. Click a dot to replay its world.",
};

/* A planner's worlds, as places in the order, from its fastest to its slowest. */
function ownOrder({ mean_s: means }) {
  const there = [...means.keys()].filter((k) => means[k] !== null);
  return there.sort((a, b) => means[a] - means[b]);
}

function drawRegression() {
  const order = report.regression.orders[byId("order").value || 0];
  const host = byId("regression");
  const entries = shownOf(order.planners).map((entry) => {
    const places = order.sorted ? ownOrder(entry) : [...entry.mean_s.keys()];
    const means = places.map((k) => entry.mean_s[k]);
    return { ...entry, places, mean_s: means, orders: order.sorted || entry.orders };
  });
  byId("order-said").textContent = ORDER_SAID[order.sorted ? "sorted" : "lines"];
  const count = order.worlds.length;
  const radius = count > MANY_DOTS ? 1.2 : count > 100 ? 2.4 : 3.6;
  const layers = [];
  for (const { planner, fit } of entries) {
    if (fit) layers.push(band(planColour(planner), fit.rank, fit.low, fit.high));
  }
  const dotsOf = ({ mean_s: means }) => {
    const ranks = [...means.keys()].filter((rank) => means[rank] !== null);
    return [ranks, ranks.map((rank) => means[rank])];
  };
  for (const entry of entries) {
    const [ranks, means] = dotsOf(entry);
    const colour = planColour(entry.planner);
    if (entry.orders) layers.push(curve(colour, ranks, means));
    else layers.push(dots(colour, ranks, means, radius));
  }
  for (const { planner, fit } of entries) {
    if (fit) layers.push(curve(planColour(planner), fit.rank, fit.line));
  }
  const drawn = drawChart(host, {
    label: `Mean time in each world, ${order.title}${order.sorted ? "" : ", with regression lines"}`,
    height: Math.min(460, Math.max(300, host.clientWidth * 0.42)),
    x: {
      domain: [0, Math.max(order.worlds.length - 1, 1)],
      title: `${order.worlds.length} worlds, ${order.axis}`,
      least: 1,
    },
    y: { domain: [0, report.limit_s * 1.02], title: "mean time [s]" },
    limit: report.limit_s,
    layers,
  });
  followPointer(host, drawn, (px, py) => {
    let best = null;
    for (const entry of entries) {
      for (const [rank, mean] of entry.mean_s.entries()) {
        if (mean === null) continue;
        const [x, y] = [drawn.X(rank), drawn.Y(mean)];
        const distance = Math.hypot(x - px, y - py);
        if (distance < 24 && (!best || distance < best.distance)) {
          const { planner, places } = entry;
          best = { distance, x, y, place: places[rank], mean, planner };
        }
      }
    }
    if (!best) return null;
    const world = order.worlds[best.place];
    const { name } = report.planners[best.planner];
    return {
      ...best,
      text: `${name}, world ${report.worlds[world].index}\n${seconds(best.mean)}`,
      mark: (svg) =>
        svg.append(
          svgElement("circle", { class: "marked", cx: best.x, cy: best.y, r: 6 }),
        ),
      pick: () => showReplay({ world, planner: best.planner }),
    };
  });
}

function startProfiles() {
  onRedraw(drawProfiles);
  onPlanners(drawProfiles);
}

function drawProfiles() {
  const host = byId("profile");
  const { grid_s: grid, planners } = report.profiles;
  const entries = shownOf(planners);
  const drawn = drawChart(host, {
    label: "Fraction of runs at the goal within a time",
    height: host.clientWidth > 440 ? 440 : 320,
    x: { domain: [0, report.limit_s], title: "time [s]" },
    y: { domain: [0, 1], title: "runs at the goal", format: percent },
    layers: [
      ...entries.map((entry) =>
        band(planColour(entry.planner), grid, entry.low, entry.high),
      ),
      ...entries.map((entry) => curve(planColour(entry.planner), grid, entry.fraction)),
    ],
  });
  followPointer(host, drawn, (px) => {
    if (px < drawn.left || px > drawn.right) return null;
    const share = (px - drawn.left) / (drawn.right - drawn.left);
    const k = Math.round(share * (grid.length - 1));
    const lines = entries
      .map((entry) => [entry.fraction[k], report.planners[entry.planner].name])
      .sort((a, b) => b[0] - a[0])
      .map(([fraction, name]) => `${percent(fraction).padStart(5)}  ${name}`);
    const x = drawn.X(grid[k]);
    return {
      x,
      y: drawn.bottom - 12,
      text: [`within ${number(grid[k], 1)} s`, ...lines].join("\n"),
      mark: (svg) =>
        svg.append(
          svgElement("line", {
            class: "guide",
            x1: x,
            x2: x,
            y1: drawn.top,
            y2: drawn.bottom,
          }),
        ),
    };
  });
}

function startIncidence() {
  const draw = () => {
    const figures = shownOf(report.incidence.planners).map((entry) => {
      const { name } = report.planners[entry.planner];
      const host = element("div");
      const figure = element(
        "figure",
        {},
        element("figcaption", {}, swatch(entry.planner), name),
        host,
      );
      return { entry, name, host, figure };
    });
    byId("incidences").replaceChildren(...figures.map(({ figure }) => figure));
    for (const { entry, name, host } of figures) drawIncidence(host, entry, name);
  };
  onRedraw(draw);
  onPlanners(draw);
}

function drawIncidence(host, entry, name) {
  const { grid_s: grid } = report.incidence;
  const add = (a, b) => a.map((value, k) => value + b[k]);
  const zero = grid.map(() => 0);
  const withContact = add(entry.goal, entry.contact);
  const all = add(withContact, entry.other);
  const last = grid.length - 1;
  drawChart(host, {
    label:
      `${name}: by ${report.limit_s} s, ${percent(entry.goal[last])} goal first, ` +
      `${percent(entry.contact[last])} contact first, ${percent(entry.other[last])} error`,
    height: 170,
    compact: true,
    x: { domain: [0, report.limit_s], title: "time [s]", ticks: 4 },
    y: { domain: [0, 1], ticks: 2, format: percent },
    layers: [
      area("goal", grid, zero, entry.goal),
      area("contact", grid, entry.goal, withContact),
      area("other", grid, withContact, all),
    ],
  });
}
