/* A page of runs that go on: it asks `hlsd view` for news, and loads itself anew without
   losing the reader's place. */

const ASK_MS = 2000;
const PLACE = "hlsd place";

function startLive() {
  restorePlace();
  if (!report.live) return;
  byId("live-now").addEventListener("click", loadAnew);
  const ask = async () => {
    try {
      const answer = await fetch("state", { cache: "no-store" });
      if (answer.ok) hear(await answer.json());
    } catch {
      byId("live").classList.add("ended");
      byId("live-said").textContent = "hlsd view has ended: this page stays as it is.";
    }
    setTimeout(ask, ASK_MS);
  };
  setTimeout(ask, ASK_MS);
}

function hear({ page, said }) {
  byId("live").classList.remove("ended");
  byId("live-said").textContent = said;
  const news = page !== report.live.page;
  byId("live-now").hidden = !news;
  if (news && byId("live-follow").checked && isIdle()) loadAnew();
}

/* Nobody watches a replay, chooses something or types. */
function isIdle() {
  const held = document.activeElement?.matches("select, input[type='search']");
  return !replay.playing && !byId("keys").open && !held && byId("metric-tip").hidden;
}

function loadAnew() {
  try {
    sessionStorage.setItem(PLACE, JSON.stringify(placeNow()));
  } catch {
    // Without a store the page begins at its top.
  }
  location.reload();
}

const keptControls = () => [
  ...document.querySelectorAll(
    "select[id]:not([id^='replay-']), input[id]:not([type='range'])",
  ),
];
const isBox = (control) => control.type === "checkbox";

/* Where the reader is: section and offset in it, and all that was chosen. */
function placeNow() {
  const sections = [...document.querySelectorAll("main section")];
  const tops = sections.map((section) => section.getBoundingClientRect().top);
  const last = tops.findLastIndex((top) => top <= 120);
  return {
    section: last < 0 ? null : sections[last].id,
    top: last < 0 ? -scrollY : tops[last],
    theme: document.documentElement.dataset.theme ?? null,
    hidden: [...hiddenPlanners].map((k) => report.planners[k].name),
    controls: keptControls().map((control) => [
      control.id,
      isBox(control)
        ? control.checked
        : (control.selectedOptions?.[0]?.text ?? control.value),
    ]),
    sort: [table.column, table.descending],
    open: [...document.querySelectorAll("details")].map(({ open }) => open),
    sideways: [...document.querySelectorAll(".scroll")].map((host) => [
      host.scrollLeft,
      host.scrollTop,
    ]),
    moment: replay.run ? momentNow() : null,
    focus: document.activeElement?.id || null,
  };
}

function restorePlace() {
  let place = null;
  try {
    place = JSON.parse(sessionStorage.getItem(PLACE));
    sessionStorage.removeItem(PLACE);
  } catch {
    return;
  }
  if (!place) return;
  history.scrollRestoration = "manual";
  if (place.theme) document.documentElement.dataset.theme = place.theme;
  report.planners.forEach(({ name }, k) => {
    if (place.hidden.includes(name))
      byId("legend").children[report.order.indexOf(k)].click();
  });
  for (const [id, value] of place.controls) restoreControl(byId(id), value);
  [table.column, table.descending] = place.sort;
  showRows();
  document.querySelectorAll("details").forEach((held, k) => {
    held.open = place.open[k] ?? held.open;
  });
  redrawAll();
  document.querySelectorAll(".scroll").forEach((host, k) => {
    [host.scrollLeft, host.scrollTop] = place.sideways[k] ?? [0, 0];
  });
  const moment = place.moment && readMoment(place.moment);
  if (moment) showMoment(moment, false);
  const section = place.section && byId(place.section);
  const top = section ? section.getBoundingClientRect().top : -scrollY;
  scrollBy({ top: top - place.top, behavior: "instant" });
  if (place.focus) byId(place.focus)?.focus({ preventScroll: true });
}

function restoreControl(control, value) {
  if (!control) return;
  if (isBox(control)) control.checked = value;
  else if (control.options) {
    const found = [...control.options].find(({ text }) => text === value);
    if (!found) return;
    control.value = found.value;
  } else control.value = value;
  for (const kind of ["input", "change"]) control.dispatchEvent(new Event(kind));
}
