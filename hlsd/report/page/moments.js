/* Moments of the replay in the page's address: planner, world, trial and time, and what
   is beside it. Another run is a step of the browser's history; another time is none. */

let noting = null;

function startMoments() {
  addEventListener("popstate", (event) => {
    const moment = readMoment(location.hash);
    if (moment) showMoment(moment, !event.state?.replay);
    else if (!location.hash) loadFirst();
  });
  byId("copy-link").addEventListener("click", async () => {
    noteMoment("replace");
    const copied = await copyText(location.href);
    saySoftly(copied ? "The link is copied." : "Copy the address of this page.");
  });
  const moment = readMoment(location.hash);
  if (moment) showMoment(moment, true);
  else loadFirst();
}

/* Fragment of the address of what is shown. */
function momentNow() {
  const { run, beside } = replay;
  const held = new URLSearchParams({
    planner: report.planners[run.planner].name,
    world: report.worlds[run.world].index,
    trial: run.trial,
    time: replay.time_s.toFixed(2),
  });
  if (beside.run) {
    held.set("beside", report.planners[beside.run.planner].name);
    held.set("beside_trial", beside.run.trial);
  }
  return `#${held}`;
}

/* What a fragment says; null where it names no moment, but a section or nothing. */
function readMoment(fragment) {
  const held = new URLSearchParams(fragment.slice(1));
  if (!held.has("planner") || !held.has("world")) return null;
  const time_s = Number(held.get("time") ?? 0);
  return {
    planner: held.get("planner"),
    world: Number(held.get("world")),
    trial: Number(held.get("trial") ?? 0),
    time_s: Number.isFinite(time_s) ? time_s : 0,
    beside: held.get("beside"),
    besideTrial: Number(held.get("beside_trial") ?? held.get("trial") ?? 0),
  };
}

function findRun(name, index, trial) {
  const world = report.worlds.findIndex((held) => held.index === index);
  return (runsOfWorld[world] ?? []).find(
    (run) => report.planners[run.planner].name === name && run.trial === trial,
  );
}

/* Show a moment; one that is not on this page leaves what is shown. */
function showMoment(moment, scrolled) {
  const { planner, world, trial, time_s } = moment;
  const run = findRun(planner, world, trial);
  const beside = moment.beside
    ? findRun(moment.beside, world, moment.besideTrial)
    : undefined;
  if (!run) {
    if (!replay.run) loadFirst();
    saySoftly(
      `The link leads to ${planner}, world ${world}, trial ${trial}, which is not on this page.`,
    );
  } else
    load([run], { time_s, beside: beside?.recorded ? beside : null, noted: false });
  if (scrolled) byId("replay").scrollIntoView();
}

/* Put what is shown into the address: "push" or "replace" in the history. */
function noteMoment(how) {
  clearTimeout(noting);
  if (!replay.run) return;
  const fragment = momentNow();
  if (fragment === location.hash) return;
  try {
    history[`${how}State`]({ replay: true }, "", fragment);
  } catch {
    // A page within another may not.
  }
}

/* Soon, as browsers refuse to be told all the time. */
function noteSoon() {
  clearTimeout(noting);
  noting = setTimeout(() => noteMoment("replace"), 250);
}

async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const field = document.body.appendChild(element("textarea", { readonly: "" }));
    field.value = text;
    field.select();
    const copied = document.execCommand("copy");
    field.remove();
    return copied;
  }
}

/* Beside the replay's controls, for those who listen, too. */
function saySoftly(text) {
  byId("replay-said").textContent = text;
}
