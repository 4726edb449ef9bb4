/* Every world as a small map, drawn when it comes into sight. */

const maps = [];

function startMaps() {
  const orders = [
    ["index", "world", (a, b) => a - b],
    ["time", "mean time, slowest first", (a, b) => worldTime(b) - worldTime(a)],
    [
      "failures",
      "failed runs, most first",
      (a, b) => worldFailures(b) - worldFailures(a),
    ],
  ];
  options(
    byId("maps-order"),
    orders.map(([name, title]) => [name, title]),
  );
  report.worlds.forEach((_, world) => maps.push(makeMap(world)));
  const watcher = new IntersectionObserver(
    (entries) => {
      for (const { target, isIntersecting } of entries) {
        const map = maps[target.dataset.world];
        map.visible = isIntersecting;
        if (isIntersecting && map.stale) drawMap(map);
      }
    },
    { rootMargin: "300px" },
  );
  for (const map of maps) watcher.observe(map.button);
  const arrange = () => {
    const [, , compare] = orders.find(([name]) => name === byId("maps-order").value);
    const only = byId("maps-failures").checked;
    const shown = [...maps.keys()].filter((world) => !only || worldFailures(world));
    shown.sort((a, b) => compare(a, b) || a - b);
    byId("map-grid").replaceChildren(...shown.map((world) => maps[world].button));
  };
  const refresh = () => {
    for (const map of maps) {
      map.stale = true;
      if (map.visible) drawMap(map);
    }
  };
  byId("maps-order").addEventListener("change", arrange);
  byId("maps-failures").addEventListener("change", arrange);
  onPlanners(() => {
    arrange();
    refresh();
  });
  onRedraw(refresh);
  arrange();
}

/* Mark the world that the replay shows. */
function markMap(world) {
  for (const map of maps)
    map.button.setAttribute("aria-current", String(map.world === world));
}

const shownRuns = (world) => runsOfWorld[world].filter((run) => isShown(run.planner));
const worldFailures = (world) => shownRuns(world).filter(failed).length;
function worldTime(world) {
  const there = shownRuns(world);
  return there.reduce((sum, run) => sum + run.time_s, 0) / Math.max(there.length, 1);
}

function makeMap(world) {
  const { index } = report.worlds[world];
  const canvas = element("canvas", { "aria-hidden": "true" });
  const verdict = element("span");
  const button = element(
    "button",
    { type: "button", class: "map", "data-world": world },
    canvas,
    element("span", { class: "line" }, element("b", {}, String(index)), verdict),
  );
  const { x, y } = report.view;
  canvas.style.aspectRatio = `${x[1] - x[0]} / ${y[1] - y[0]}`;
  button.addEventListener("click", () => showReplay({ world }));
  return { world, button, canvas, verdict, stale: true, visible: false };
}

async function drawMap(map) {
  map.stale = false;
  const there = shownRuns(map.world);
  const failures = there.filter(failed).length;
  const words = failures ? `${failures} failed` : "";
  map.verdict.textContent = words;
  const { index } = report.worlds[map.world];
  map.button.setAttribute(
    "aria-label",
    `Replay world ${index}${words && `: ${words}`}`,
  );
  const kept = there.filter((run) => run.recorded);
  const trajectories = await Promise.all(kept.map(trajectoryOf));
  const drawing = prepare(map.canvas);
  drawWorld(drawing, map.world);
  drawing.pen.globalAlpha = 0.75;
  kept.forEach((run, k) =>
    drawTrack(drawing, trajectories[k], planColour(run.planner), 1.1),
  );
  drawing.pen.globalAlpha = 1;
  kept.forEach((run, k) => drawMishaps(drawing, trajectories[k], run, 3.5));
}
