/* What a metric is, beside its name: for the pointer, by the keyboard, at a touch. */

const tips = { button: null, timer: null };

function startTips() {
  const tip = byId("metric-tip");
  for (const head of document.querySelectorAll("th[data-metric]")) {
    const button = head.querySelector("button");
    if (!report.metrics[head.dataset.metric]) continue;
    head.classList.add("told");
    button.setAttribute("aria-describedby", "metric-tip");
    const show = () => showTip(button, report.metrics[head.dataset.metric]);
    for (const kind of ["pointerenter", "focus", "click"])
      button.addEventListener(kind, show);
    button.addEventListener("blur", hideTip);
    button.addEventListener("pointerleave", hideTipSoon);
  }
  tip.addEventListener("pointerenter", () => clearTimeout(tips.timer));
  tip.addEventListener("pointerleave", hideTipSoon);
  document.addEventListener("keydown", ({ key }) => key === "Escape" && hideTip());
  addEventListener("scroll", placeTip, { passive: true, capture: true });
}

function showTip(button, { title, unit, definition, better, source }) {
  clearTimeout(tips.timer);
  const tip = byId("metric-tip");
  tip.replaceChildren(
    element("b", {}, unit ? `${title} [${unit}]` : title),
    element("p", {}, definition),
    element(
      "p",
      { class: "more" },
      better ? `The ${better}, the better. ` : "",
      source,
    ),
  );
  tip.hidden = false;
  tips.button = button;
  placeTip();
}

/* Below its button, or above where there is no room; it goes where that goes. */
function placeTip() {
  const tip = byId("metric-tip");
  if (tip.hidden) return;
  const box = tips.button.getBoundingClientRect();
  const clamp = (value, room) => Math.max(8, Math.min(value, room - 8));
  const above = box.bottom + 6 + tip.offsetHeight > innerHeight;
  const top = above ? box.top - tip.offsetHeight - 6 : box.bottom + 6;
  tip.style.left = `${clamp(box.left, innerWidth - tip.offsetWidth)}px`;
  tip.style.top = `${Math.max(8, top)}px`;
}

function hideTip() {
  clearTimeout(tips.timer);
  byId("metric-tip").hidden = true;
}

/* Time for the pointer to reach it. */
function hideTipSoon() {
  clearTimeout(tips.timer);
  tips.timer = setTimeout(hideTip, 200);
}
