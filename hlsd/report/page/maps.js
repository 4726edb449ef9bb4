/* Every world as a small map, drawn when it comes into sight. */

/* Those of the page of them that is shown. */
let maps = [];
const MAPS_PER_PAGE = 300;

function startMaps() {
  // Worlds go by what is greatest first, then by index.
  const orders = [
    ["index", "world", () => 0],
    ["time", "mean time, slowest first", worldTime],
    ["failures", "failed runs, most first", worldFailures],
  ];
  options(
    byId("maps-order"),
    orders.map(([name, title]) => [name, title]),
  );
  const watcher = new IntersectionObserver(
    (entries) => {
      for (const { target, isIntersecting } of entries) {
        const map = maps.find(({ button }) => button === target);
        if (!map) continue; // of a page that was left
        map.visible = isIntersecting;
        if (isIntersecting && map.stale) drawMap(map);
      }
    },
    { rootMargin: "300px" },
  );
  const show = paged("maps-pages", MAPS_PER_PAGE, (worlds) => {
    const there = new Map(maps.map((map) => [map.world, map]));
    watcher.disconnect();
    maps = worlds.map((world) => there.get(world) ?? makeMap(world));
    byId("map-grid").replaceChildren(...maps.map(({ button }) => button));
    for (const map of maps) watcher.observe(map.button);
    markMap(replay.run?.world);
  });
  const arrange = () => {
    const [, , worth] = orders.find(([name]) => name === byId("maps-order").value);
    const only = byId("maps-failures").checked;
    const worths = report.worlds.map((_, world) => worth(world));
    const shown = [...worths.keys()].filter((world) => !only || worldFailures(world));
    show(shown.sort((a, b) => worths[b] - worths[a] || a - b));
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
